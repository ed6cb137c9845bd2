"""What examples use of ONNX Runtime's Python package, which Debian lacks, by its package for node."""

import json
import os
import subprocess
import tempfile

import numpy as np


class InferenceSession:
    def __init__(self, path):
        self.path = path

    def run(self, names, inputs):
        assert names is None
        with tempfile.TemporaryDirectory() as folder:
            asked = {"model": self.path, "output": f"{folder}/output", "inputs": []}
            for name, values in inputs.items():
                assert values.dtype == np.float32, f"{name}: expected float32, found {values.dtype}"
                np.ascontiguousarray(values).tofile(f"{folder}/{name}")
                asked["inputs"].append(
                    {"name": name, "shape": values.shape, "file": f"{folder}/{name}"})
            with open(f"{folder}/scene.json", "w") as scene:
                json.dump(asked, scene)
            script = os.path.join(os.path.dirname(__file__), "run.js")
            shape = subprocess.check_output(["node", script, scene.name])
            return [np.fromfile(asked["output"], np.float32).reshape(json.loads(shape))]
