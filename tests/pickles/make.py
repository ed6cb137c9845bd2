"""Makes the pickles of this folder, read by tests/test_pickle.cpp. Needs NumPy, SciPy and joblib.

chumpy's classes are stood in for by empty ones: their pickles look the same.
"""
import collections
import pathlib
import pickle
import sys
import types

import joblib
import numpy as np
import scipy.sparse


def stand_in(module, name):
    cls = type(name, (object,), {"__module__": module})
    sys.modules.setdefault("chumpy", types.ModuleType("chumpy"))
    sys.modules.setdefault(module, types.ModuleType(module))
    setattr(sys.modules[module], name, cls)
    return cls


def content():
    ch = stand_in("chumpy.ch", "Ch")()
    ch.x = np.arange(6, dtype="f8").reshape(1, 2, 3) / 2
    ch._dirty_vars = {"x"}
    ch._itr = None
    select = stand_in("chumpy.reordering", "Select")()
    select.a = ch
    select.idxs = np.array([5, 0])
    select.preferred_shape = (2, 1)
    dense = np.array([[0, 0.25, 0, 0.75], [1.0, 0, 0, 0]])
    return collections.OrderedDict([
        ("pose", np.array([0.1, -2.5, 3e-3])),
        ("faces", np.array([[0, 1, 2], [2, 1, 3]], dtype="u4")),
        ("fortran", np.asfortranarray(np.arange(6, dtype="i2").reshape(2, 3))),
        ("big", np.arange(3, dtype=">f4")),
        ("shapedirs", ch),
        ("select", select),
        ("J_regressor", scipy.sparse.csc_matrix(dense)),
        ("csr", scipy.sparse.csr_matrix(dense)),
        ("coo", scipy.sparse.coo_matrix(dense)),
        ("n", 7),
        ("neg", -300),
        ("long", 2**40),
        ("minus", -2**63),
        ("f", 1.5),
        ("yes", True),
        ("none", None),
        ("scalar", np.float32(0.25)),
        ("list", [1, 2.5, 3]),
        ("rows", [[1, 2], [3, 4]]),
        ("name", "Zo\xeb"),
        ("raw", b"a\x00\xff"),
        (3, "three"),
        ("nested", {"k": [np.ones(2), np.zeros(2)]}),
        ("empty", np.zeros((0, 3))),
        ("objects", np.array([1, 2.5], dtype=object)),
        ("text", np.array("male")),
        ("set", {1}),
        ("counts", collections.defaultdict(list, a=[1])),
    ])


if __name__ == "__main__":
    folder = pathlib.Path(__file__).parent
    for protocol in range(6):
        (folder / f"protocol{protocol}.pkl").write_bytes(pickle.dumps(content(), protocol))
    people = {1: {"verts": np.arange(12, dtype="f4").reshape(2, 2, 3), "ids": np.array([4, 9])}}
    joblib.dump(people, folder / "joblib.pkl")
    joblib.dump(people, folder / "joblib_zlib.pkl", compress=3)
    results = {"pose": np.arange(3, dtype="f4")}
    np.savez(folder / "objects.npz", results=np.array(results, dtype=object), n=np.int32(3))
