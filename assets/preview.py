"""Pictures of meshes without a GPU: a z-buffer in NumPy, to look at what the converters made."""

import numpy as np


def rasterise(xy, depth, faces, width, height):
    """Nearest face per pixel. xy [V, 2] pixels, depth [V] (small = near), faces [F, 3].

    Returns face ids [H, W] (-1: none) and the barycentrics [H, W, 3].
    """
    corners = xy[faces]
    low = np.maximum(np.ceil(corners.min(1) - .5), 0).astype(int)
    high = np.minimum(np.floor(corners.max(1) - .5), (width - 1, height - 1)).astype(int)
    size = np.maximum(high - low + 1, 0)
    count = size[:, 0] * size[:, 1]
    ids = np.full(width * height, -1)
    best = np.full(width * height, np.inf)
    bary = np.zeros((width * height, 3))
    area2 = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    order = np.flatnonzero((count > 0) & (np.abs(area2) > 1e-12))
    chunks = np.searchsorted(np.cumsum(count[order]), np.arange(0, count[order].sum(), 4_000_000))
    for begin, end in zip(chunks, list(chunks[1:]) + [len(order)]):
        face = np.repeat(order[begin:end], count[order[begin:end]])
        first = np.cumsum(count[order[begin:end]]) - count[order[begin:end]]
        k = np.arange(len(face)) - np.repeat(first, count[order[begin:end]])
        x, y = low[face, 0] + k % size[face, 0], low[face, 1] + k // size[face, 0]
        p = np.stack([x, y], 1) + .5
        a, b, c = corners[face, 0], corners[face, 1], corners[face, 2]
        w = np.stack([np.cross(c - b, p - b), np.cross(a - c, p - c), np.cross(b - a, p - a)], 1)
        w /= area2[face, None]
        inside = (w >= 0).all(1)
        face, w, pixel = face[inside], w[inside], (y * width + x)[inside]
        z = (w * depth[faces[face]]).sum(1)
        far_first = np.argsort(-z, kind='stable')  # the last write to a pixel stays: the nearest
        face, w, pixel, z = face[far_first], w[far_first], pixel[far_first], z[far_first]
        nearer = z < best[pixel]
        face, w, pixel, z = face[nearer], w[nearer], pixel[nearer], z[nearer]
        ids[pixel], best[pixel], bary[pixel] = face, z, w
    return ids.reshape(height, width), bary.reshape(height, width, 3)


def vertex_normals(vertices, faces):
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(total, faces[:, k], normal)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-20)


def turn_y(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def picture(vertices, faces, degrees=0, centre=None, extent=None, size=(600, 600), uv=None,
            uv_faces=None, texture=None, sharp=False):
    """An orthographic view [H, W, 3] uint8; degrees turn the body to its left.

    extent: metres over the picture's height. Without a texture, grey; back faces show in red.
    """
    width, height = size
    middle = (vertices.min(0) + vertices.max(0)) / 2 if centre is None else np.asarray(centre)
    turned = (vertices - middle) @ turn_y(degrees).T
    scale = height / (np.ptp(vertices[:, 1]) * 1.05 if extent is None else extent)
    xy = np.stack([width / 2 + turned[:, 0] * scale, height / 2 - turned[:, 1] * scale], 1)
    ids, bary = rasterise(xy, -turned[:, 2], faces, width, height)
    hit = ids >= 0
    f, w = ids[hit], bary[hit]
    corners = turned[faces[f]]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if sharp:
        normal = flat / np.linalg.norm(flat, axis=1, keepdims=True)
    else:
        smooth = vertex_normals(turned, faces)
        normal = (w[..., None] * smooth[faces[f]]).sum(1)
    light = .35 + .65 * np.clip(normal @ (np.array([.35, .5, .8]) / np.linalg.norm([.35, .5, .8])),
                                0, 1)
    colour = np.full((len(f), 3), 205.)
    if texture is not None:
        t = (w[..., None] * uv[uv_faces[f]]).sum(1)
        rows, columns = texture.shape[:2]
        colour = texture[np.clip((t[:, 1] * rows).astype(int), 0, rows - 1),
                         np.clip((t[:, 0] * columns).astype(int), 0, columns - 1)].astype(float)
    colour = np.where(flat[:, 2:] < 0, (220., 30., 30.), colour)
    image = np.full((height, width, 3), 255.)
    image[hit] = colour * light[:, None]
    return image.astype(np.uint8)


def sheet(images, columns):
    """Pictures of one size in a grid."""
    blank = np.full_like(images[0], 255)
    rows = [images[i:i + columns] for i in range(0, len(images), columns)]
    rows[-1] = rows[-1] + [blank] * (columns - len(rows[-1]))
    return np.vstack([np.hstack(r) for r in rows])
