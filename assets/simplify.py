"""Fewer triangles by half-edge collapses, symmetric in x, guided by quadric errors.

A collapse moves vertex a onto a neighbour b, so the vertices that remain are vertices of the
source: shape directions, skinning weights, labels and UVs are inherited by index.
(Garland and Heckbert, "Surface simplification using quadric error metrics", 1997.)
"""

import heapq

import numpy as np

MIN_NORMAL_COSINE = .3  # how far a triangle may turn in one collapse
MIN_SHAPE = .08  # 4 sqrt(3) area / sum of squared edges: 1 for equilateral triangles


class Mesh:
    """Triangles with UV corners, and what the collapses need to know about them."""

    def __init__(self, vertices, faces, uvs, uv_faces, importance):
        self.p = vertices.tolist()
        self.f = [tuple(t) for t in faces.tolist()]
        self.t = [tuple(t) for t in uv_faces.tolist()]
        self.uv = uvs.tolist()
        self.around = [set() for _ in self.p]  # faces at each vertex
        for i, face in enumerate(self.f):
            for v in face:
                self.around[v].add(i)
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        area = np.linalg.norm(normal, axis=1)
        plane = np.concatenate([normal, -(normal * a).sum(1, keepdims=True)], 1)
        plane /= np.maximum(area, 1e-20)[:, None]
        quadric = plane[:, :, None] * plane[:, None, :] * (area / 2)[:, None, None]
        total = np.zeros((len(vertices), 4, 4))
        for k in range(3):
            np.add.at(total, faces[:, k], quadric)
        self.q = total * importance[:, None, None]

    def neighbours(self, v):
        return {u for i in self.around[v] for u in self.f[i]} - {v}

    def cost(self, a, b):
        x = np.array([*self.p[b], 1])
        length2 = sum((s - t) ** 2 for s, t in zip(self.p[a], self.p[b]))
        return float(x @ (self.q[a] + self.q[b]) @ x) + 1e-9 * length2

    def corner_uv(self, face, v):
        return self.t[face][self.f[face].index(v)]

    def plan(self, a, b):
        """The faces after a moved onto b: {face: (corners, uv corners)}, or None if it may not."""
        shared = self.around[a] & self.around[b]
        if len(shared) != 2 or len(self.neighbours(a) & self.neighbours(b)) != 2:
            return None  # it would pinch the surface
        uv_b = {self.corner_uv(i, b) for i in shared}
        if len(uv_b) != 1:
            return None
        uv_b = uv_b.pop()
        result = {}
        for i in self.around[a] - shared:
            corners = tuple(b if v == a else v for v in self.f[i])
            uv_corners = tuple(uv_b if v == a else t for v, t in zip(self.f[i], self.t[i]))
            before, after = self.normal(self.f[i]), self.normal(corners)
            n0, n1 = norm(before), norm(after)
            if dot(before, after) < MIN_NORMAL_COSINE * n0 * n1:
                return None
            squares = sum((s - t) ** 2 for k in range(3)
                          for s, t in zip(self.p[corners[k]], self.p[corners[k - 1]]))
            if 2 * 3 ** .5 * n1 < MIN_SHAPE * squares:
                return None
            if self.uv_area(self.t[i]) * self.uv_area(uv_corners) <= 0:
                return None
            result[i] = corners, uv_corners
        return result

    def normal(self, corners):
        a, b, c = (self.p[v] for v in corners)
        u, v = [s - t for s, t in zip(b, a)], [s - t for s, t in zip(c, a)]
        return (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])

    def uv_area(self, corners):
        a, b, c = (self.uv[t] for t in corners)
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

    def apply(self, a, b, plan):
        for i in self.around[a] & self.around[b]:
            for v in self.f[i]:
                if v != a:
                    self.around[v].discard(i)
            self.f[i] = None
        for i, (corners, uv_corners) in plan.items():
            self.f[i], self.t[i] = corners, uv_corners
            self.around[b].add(i)
        self.around[a] = set()
        self.q[b] += self.q[a]


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def norm(a):
    return dot(a, a) ** .5


def collapse(vertices, faces, uvs, uv_faces, twin, movable, importance, goal):
    """Collapses until `goal` vertices remain.

    twin [V] is each vertex's mirror image; vertices that are not movable, and all on UV seams,
    stay; importance [V] scales the error. Returns (kept vertex ids ascending, faces, uv_faces) in
    the ids of the source.
    """
    mesh = Mesh(vertices, faces, uvs, uv_faces, importance)
    pairs = np.unique(np.stack([faces.ravel(), uv_faces.ravel()], 1), axis=0)
    movable = movable & (np.bincount(pairs[:, 0], minlength=len(vertices)) == 1)
    movable &= movable[twin]
    twin = twin.tolist()
    stamp = [0] * len(vertices)
    heap = []

    def push(a, b):
        # The left stands for both sides; a vertex on the middle line must stay on it.
        if movable[a] and on_left[a] and not (a == twin[a] and b != twin[b]):
            heapq.heappush(heap, (mesh.cost(a, b), a, b, stamp[a], stamp[b]))

    on_left = vertices[:, 0] >= 0
    for a in range(len(vertices)):
        for b in mesh.neighbours(a):
            push(a, b)
    remaining = len(vertices)
    while remaining > goal and heap:
        _, a, b, stamp_a, stamp_b = heapq.heappop(heap)
        if stamp[a] != stamp_a or stamp[b] != stamp_b or not mesh.around[a]:
            continue
        moves = [(a, b)] if a == twin[a] else [(a, b), (twin[a], twin[b])]
        plans = [mesh.plan(*move) for move in moves]
        if any(plan is None for plan in plans):
            continue
        touched = set()
        for move, plan in zip(moves, plans):
            touched |= mesh.neighbours(move[0])
            mesh.apply(*move, plan)
            remaining -= 1
        for v in touched:
            stamp[v] += 1
        for v in touched:
            for u in mesh.neighbours(v):
                push(v, u)
                push(u, v)
    alive = [i for i, face in enumerate(mesh.f) if face is not None]
    new_faces = np.array([mesh.f[i] for i in alive], np.int32)
    return np.unique(new_faces), new_faces, np.array([mesh.t[i] for i in alive], np.int32)
