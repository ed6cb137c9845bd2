"""SMPL's 24 joints on MakeHuman's mesh: joints, skinning weights, and the T-pose.

Left and right are the person's; left is +x. Every table is written for the left side and
mirrored, so that the body is exactly symmetric.
"""

import numpy as np

JOINTS = ('pelvis l_hip r_hip spine1 l_knee r_knee spine2 l_ankle r_ankle spine3 l_foot r_foot '
          'neck l_collar r_collar head l_shoulder r_shoulder l_elbow r_elbow l_wrist r_wrist '
          'l_hand r_hand').split()
PARENTS = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21]
MIRROR_JOINT = [JOINTS.index({'l_': 'r_', 'r_': 'l_'}.get(n[:2], n[:2]) + n[2:]) for n in JOINTS]
KINTREE = np.array([PARENTS, range(24)], np.int32)

# Joint = weighted sum of bone heads of the A-posed average body, plus z, with the radius (dm)
# around it in which body vertices may carry it, and the joints those vertices may belong to.
JOINT_RULES = {
    'pelvis': ({'spine05': 1}, 0, 1.9, 'pelvis l_hip r_hip spine1'),
    'l_hip': ({'spine05': .3, 'upperleg02.L': .7}, 0, 1.7, 'pelvis l_hip'),
    'spine1': ({'spine03': 1}, 0, 1.8, 'pelvis spine1 spine2'),
    'spine2': ({'spine02': .7, 'spine01': .3}, 0, 1.8, 'spine1 spine2 spine3'),
    'spine3': ({'spine02': .36, 'spine01': .64}, 0, 1.9, 'spine1 spine2 spine3'),
    'l_knee': ({'lowerleg01.L': 1}, 0, 1.0, 'l_hip l_knee'),
    'l_ankle': ({'foot.L': 1}, 0, .8, 'l_knee l_ankle'),
    'l_foot': ({'toe2-1.L': .5, 'toe3-1.L': .5}, 0, .9, 'l_ankle l_foot'),
    'neck': ({'neck01': 1}, -.30, 1.1, 'spine3 neck'),
    'head': ({'neck02': .35, 'neck03': .65}, 0, 1.3, 'neck head'),
    'l_collar': ({'spine01': .4, 'shoulder01.L': .6}, 0, 1.5, 'spine2 spine3 l_collar'),
    'l_shoulder': ({'upperarm01.L': 1}, -.15, 1.2, 'l_collar l_shoulder'),
    'l_elbow': ({'lowerarm01.L': 1}, 0, .8, 'l_shoulder l_elbow'),
    'l_wrist': ({'wrist.L': 1}, 0, .6, 'l_elbow l_wrist l_hand'),
    'l_hand': ({'finger3-1.L': 1}, 0, .7, 'l_wrist l_hand'),
    # Not joints of the body: they only say how the hand is turned.
    'l_index': ({'finger2-1.L': 1}, 0, .7, 'l_wrist l_hand'),
    'l_little': ({'finger5-1.L': 1}, 0, .7, 'l_wrist l_hand'),
}
POINTS = JOINTS + ['l_index', 'r_index', 'l_little', 'r_little']

# MakeHuman bone -> joint: the first prefix that fits; all other bones move with the head.
BONE_RULES = [
    ('root', 'pelvis'), ('pelvis', 'pelvis'), ('spine05', 'pelvis'), ('spine04', 'pelvis'),
    ('spine03', 'spine1'), ('spine02', 'spine2'), ('breast', 'spine2'), ('spine01', 'spine3'),
    ('neck01', 'neck'), ('neck02', 'neck'), ('clavicle', 'l_collar'), ('shoulder01', 'l_collar'),
    ('upperarm', 'l_shoulder'), ('lowerarm', 'l_elbow'), ('wrist', 'l_wrist'),
    ('metacarpal', 'l_wrist'), ('finger', 'l_hand'), ('upperleg', 'l_hip'),
    ('lowerleg', 'l_knee'), ('foot', 'l_ankle'), ('toe', 'l_foot'),
]

PART_NAMES = ('', 'head', 'torso', 'l_upperarm', 'r_upperarm', 'l_forearm', 'r_forearm',
              'l_thigh', 'r_thigh', 'l_calf', 'r_calf', 'l_foot', 'r_foot', 'l_hand', 'r_hand')
PART_OF_JOINT = np.array([2, 7, 8, 2, 9, 10, 2, 11, 12, 2, 11, 12, 1, 2, 2, 1, 3, 4, 5, 6, 13, 14,
                          13, 14], np.uint8)

# Where SMPL's template has its limbs (metres, left side): the T-pose's directions.
THIGH = (.024, -.375, -.004)
SHIN = (-.004, -.398, -.044)
COLLAR = (.091, .031, -.009)
FOOT_YAW = np.radians(12)  # outward
PELVIS = np.array([0, -.223, .028])  # SMPL's, so that translations of SMPL data hold


def joint_of_bone(bone):
    for prefix, joint in BONE_RULES:
        if bone.startswith(prefix):
            if bone.endswith('.R') and joint.startswith('l_'):
                joint = 'r_' + joint[2:]
            return JOINTS.index(joint)
    return JOINTS.index('head')


def merge_weights(bone_weights, bone_names, quads, twin, smoothing_steps=8):
    """MakeHuman's weights [V, bones] -> [V, 24], smoothed: unsmoothed armpits and collars tear."""
    merged = np.zeros((len(bone_weights), 24))
    for column, bone in enumerate(bone_names):
        merged[:, joint_of_bone(bone)] += bone_weights[:, column]
    edges = np.concatenate([quads[:, [i, (i + 1) % 4]] for i in range(4)])
    edges = np.unique(np.sort(edges, 1), axis=0)
    edges = np.concatenate([edges, edges[:, ::-1]])
    degree = np.bincount(edges[:, 0])[:, None]
    for _ in range(smoothing_steps):
        total = np.zeros_like(merged)
        np.add.at(total, edges[:, 0], merged[edges[:, 1]])
        merged = .5 * merged + .5 * total / degree
    return keep_four(.5 * (merged + merged[twin][:, MIRROR_JOINT]))


def keep_four(weights):
    """The (at most) four largest weights of each row, summing to one.

    Larger than the fifth, so that of a left and a right joint with equal weight none is favoured.
    """
    kept = np.where(weights > np.sort(weights, 1)[:, -5:-4], weights, 0)
    return kept / kept.sum(1, keepdims=True)


def spread_weights(vertices, point, stiffness):
    """Weights w >= 0 on vertices [m, 3] that sum to one and average to the point, nearly.

    The least of |s (V^T w - point)|^2 + |s (sum w - 1)|^2 + m |w - 1/m|^2 for stiffness s: the
    last term spreads w over many vertices, so that it holds for other shapes too. Solved in its
    four dual variables y, w = max(0, (1 - A^T y) / m), by Newton steps with backtracking.
    """
    m = len(vertices)
    a = stiffness * np.vstack([vertices.T, np.ones(m)])
    b = stiffness * np.append(point, 1)

    def primal(y):
        return np.maximum(0, 1 - a.T @ y) / m

    def dual(y):
        return .5 * y @ y + b @ y + .5 * m * np.sum(primal(y) ** 2)

    y = np.zeros(4)
    for _ in range(200):
        w = primal(y)
        gradient = y + b - a @ w
        if np.abs(gradient).max() < 1e-9:
            break
        active = a[:, w > 0]
        step = np.linalg.solve(np.eye(4) + active @ active.T / m, gradient)
        scale = 1.
        while scale > 1e-9 and dual(y - scale * step) > dual(y) - 1e-4 * scale * gradient @ step:
            scale *= .5
        y = y - scale * step
    return w / w.sum()


def fit_regressor(points, vertices, dominant, twin, stiffness=100):
    """Rows of weights on nearby vertices that average to each of the points: [P, V].

    points [P, 3], the first P of POINTS, and vertices [V, 3] in dm; dominant [V] is the joint that
    moves a vertex most; twin [V] its mirror image.
    """
    rows = np.zeros((len(points), len(vertices)))
    for name, (_, _, radius, carriers) in JOINT_RULES.items():
        i = POINTS.index(name)
        if i >= len(points):
            continue
        carriers = [JOINTS.index(c) for c in carriers.split()]
        near = np.linalg.norm(vertices - points[i], axis=1) < radius
        ids = np.flatnonzero(near & np.isin(dominant, carriers))
        rows[i, ids] = spread_weights(vertices[ids], points[i], stiffness)
        if name.startswith('l_'):
            rows[POINTS.index('r_' + name[2:])] = rows[i, twin]
        else:
            rows[i] = .5 * (rows[i] + rows[i, twin])
    return rows


def bone_points(source, vertices):
    """The points of the A-posed average body [len(POINTS), 3], symmetric."""
    points = np.zeros((len(POINTS), 3))
    for name, (terms, dz, _, _) in JOINT_RULES.items():
        def at(terms):
            return sum(w * source.bone_head(b, vertices) for b, w in terms.items()) + (0, 0, dz)
        other = at({b.removesuffix('.L') + '.R' if b.endswith('.L') else b: w
                    for b, w in terms.items()})
        mean = .5 * (at(terms) + other * (-1, 1, 1))
        points[POINTS.index(name)] = mean
        if name.startswith('l_'):
            points[POINTS.index('r_' + name[2:])] = mean * (-1, 1, 1)
    return points


def unit(x):
    return np.asarray(x, float) / np.linalg.norm(x)


def swing(a, b):
    """The smallest rotation that turns direction a into direction b."""
    a, b = unit(a), unit(b)
    x, y, z = np.cross(a, b)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + k + k @ k / (1 + a @ b)


def frame(axis, up):
    """Columns: axis, the part of up across it, and their cross product."""
    axis = unit(axis)
    up = unit(up - axis * (axis @ up))
    return np.stack([axis, up, np.cross(axis, up)], 1)


def t_pose_rotations(points):
    """World rotations [24, 3, 3] that bring the A-posed limbs into SMPL's T-pose."""
    rotations = np.tile(np.eye(3), (24, 1, 1))
    for side, flip in (('l_', 1), ('r_', -1)):
        mirror = np.array([flip, 1, 1])

        def p(name):
            return points[POINTS.index(side + name)]

        def turn(rotation, *names):
            for name in names:
                rotations[JOINTS.index(side + name)] = rotation

        turn(swing(p('knee') - p('hip'), mirror * THIGH), 'hip')
        turn(swing(p('ankle') - p('knee'), mirror * SHIN), 'knee')
        toes = p('foot') - p('ankle')
        yaw = flip * FOOT_YAW - np.arctan2(toes[0], toes[2])
        c, s = np.cos(yaw), np.sin(yaw)
        turn(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), 'ankle', 'foot')
        turn(swing(p('shoulder') - p('collar'), mirror * COLLAR), 'collar')

        # Arms along x, elbows bending forward, palms down.
        upper, fore = p('elbow') - p('shoulder'), p('wrist') - p('elbow')
        hinge = np.cross(upper, fore)
        out = np.array([flip, 0, 0])
        arm = frame(out, np.array([0, -flip, 0]))
        turn(arm @ frame(upper, hinge).T, 'shoulder')
        turn(arm @ frame(fore, hinge).T, 'elbow')
        across = p('index') - p('little')
        turn(frame(out, np.array([0, 0, 1])) @ frame(p('hand') - p('wrist'), across).T,
             'wrist', 'hand')
    return rotations


def posed_joints(joints, rotations):
    """Forward kinematics with world rotations: joints [24, 3] of the pose."""
    result = joints.copy()
    for j in range(1, 24):
        p = PARENTS[j]
        result[j] = result[p] + rotations[p] @ (joints[j] - joints[p])
    return result


def to_t_pose(vertices, weights, points):
    """A-pose -> T-pose by exact inverse skinning, so that posing it back gives the A-pose again.

    vertices [N, 3] dm, weights [N, 24], points from a regressor. Returns vertices [N, 3] and
    joints [24, 3] in metres with the pelvis at SMPL's place.
    """
    a_joints = points[:24]
    rotations = t_pose_rotations(points)
    t_joints = posed_joints(a_joints, rotations)
    back = rotations.transpose(0, 2, 1)  # T-pose -> A-pose: x_A = back x_T + shift
    shift = a_joints - np.einsum('jab,jb->ja', back, t_joints)
    matrix = (weights @ back.reshape(24, 9)).reshape(-1, 3, 3)
    result = np.linalg.solve(matrix, (vertices - weights @ shift)[..., None])[..., 0]
    return (result - t_joints[0]) * .1 + PELVIS, (t_joints - t_joints[0]) * .1 + PELVIS


def pose(vertices, joints, weights, theta):
    """SMPL's linear blend skinning; theta [24, 3] axis-angle, for previews and checks."""
    world = np.zeros((24, 4, 4))
    for j in range(24):
        angle = np.linalg.norm(theta[j])
        x, y, z = theta[j] / angle if angle > 0 else (0, 0, 0)
        k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        local = np.eye(4)
        local[:3, :3] += np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
        p = PARENTS[j]
        local[:3, 3] = joints[j] - (joints[p] if p >= 0 else 0)
        world[j] = local if p < 0 else world[p] @ local
    world[:, :3, 3] -= np.einsum('jab,jb->ja', world[:, :3, :3], joints)
    blend = (weights @ world.reshape(24, 16)).reshape(-1, 4, 4)
    return np.einsum('vab,vb->va', blend[:, :3, :3], vertices) + blend[:, :3, 3]
