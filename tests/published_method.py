"""[Tao21] once more, plainly, in numpy and OpenCV: nothing of the program's own, to hold `--method tao2021` against."""

from itertools import combinations, pairwise

import cv2
import numpy as np

FLOAT = np.float64
# of the 16 intrinsics, those of OpenCV's distortion in its order: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4
OPENCV = [4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]


def normalised(uv, camera, intrinsics):
    """Image points (n,2) px as seen by ideal cameras of focal length 1."""
    out = np.empty_like(uv)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-15)
    for c, lens in enumerate(intrinsics):
        rows = camera == c
        matrix = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])
        if rows.any():
            out[rows] = cv2.undistortPoints(uv[rows][:, None], matrix, lens[OPENCV], criteria=criteria)[:, 0]
    return out


def project(intrinsics, x):
    """Image points of a point in the frames of its cameras, (n,16) and (n,3); the lens terms of the paper."""
    a, b = x[:, 0] / x[:, 2], x[:, 1] / x[:, 2]
    r2 = a * a + b * b
    i = intrinsics.T
    radial = 1 + r2 * (i[4] + r2 * (i[5] + r2 * i[8]))
    u = a * radial + 2 * i[6] * a * b + i[7] * (r2 + 2 * a * a) + i[12] * r2 + i[13] * r2**2
    v = b * radial + i[6] * (r2 + 2 * b * b) + 2 * i[7] * a * b + i[14] * r2 + i[15] * r2**2
    return np.stack([i[0] * u + i[2], i[1] * v + i[3]], axis=1)


# --- (3)-(9) ----------------------------------------------------------------------------------------------------------


def fundamental(a, b):
    """F with b' F a = 0, by the normalised eight-point algorithm."""

    def similarity(p):
        mean = p.mean(axis=0)
        s = np.sqrt(2) / np.linalg.norm(p - mean, axis=1).mean()
        return np.array([[s, 0, -s * mean[0]], [0, s, -s * mean[1]], [0, 0, 1]])

    ta, tb = similarity(a), similarity(b)
    ha, hb = (np.column_stack([p, np.ones(len(p))]) @ t.T for p, t in ((a, ta), (b, tb)))
    rows = [np.outer(q, p).ravel() for p, q in zip(ha, hb, strict=True)]
    u, s, vt = np.linalg.svd(np.linalg.svd(np.array(rows))[2][-1].reshape(3, 3))
    return tb.T @ u @ np.diag([s[0], s[1], 0]) @ vt @ ta


def group(xy):
    """Rotations, translations and points of three cameras from common normalised points (3,n,2)."""
    n = xy.shape[1]
    h = np.concatenate([xy, np.ones((3, n, 1))], axis=2)
    depth = [np.ones(n)]
    for j in (1, 2):
        f = fundamental(xy[0], xy[j])
        epipole = np.linalg.svd(f.T)[2][-1]
        across = np.cross(epipole, h[j])
        depth.append(np.sum(across * (h[0] @ f.T), axis=1) / np.sum(across**2, axis=1))  # (5)
    w = np.vstack([(h[j] * depth[j][:, None]).T for j in range(3)])
    for _ in range(3):
        w = w / np.linalg.norm(w, axis=0)
        w = np.vstack([part / np.linalg.norm(part) for part in np.split(w, 3)])
    u, s, vt = np.linalg.svd(w, full_matrices=False)  # (6)
    p, x = u[:, :4] @ np.diag(np.sqrt(s[:4])), np.diag(np.sqrt(s[:4])) @ vt[:4]
    p = np.split(p, 3)
    return upgraded(p, x)


def upgraded(p, x):
    """(7)-(9): the dual quadric W with P W P' ~ I, its root, and the choice of signs with most points in front."""
    basis = []
    for i in range(4):
        for j in range(i, 4):
            e = np.zeros((4, 4))
            e[i, j] = e[j, i] = 1
            basis.append(e)
    rows = []
    for one in p:
        q = one / np.linalg.norm(one[2])
        made = [q @ e @ q.T for e in basis]
        rows += [[m[0, 0] - m[1, 1] for m in made], [m[1, 1] - m[2, 2] for m in made]]
        rows += [[m[a, b] for m in made] for a, b in ((0, 1), (0, 2), (1, 2))]
    quadric = sum(k * e for k, e in zip(np.linalg.svd(np.array(rows))[2][-1], basis, strict=True))
    if -np.linalg.eigvalsh(quadric)[0] > np.linalg.eigvalsh(quadric)[3]:
        quadric = -quadric
    values, vectors = np.linalg.eigh(quadric)
    if values[1] <= 0:
        values = np.abs(values)
    root = vectors[:, 1:] * np.sqrt(np.abs(values[1:]))
    centre = np.linalg.svd(p[0])[2][3]
    best = None
    for sign in (1, -1):
        h = np.column_stack([root, sign * centre])
        points = np.linalg.inv(h) @ x
        rotation, translation = [], []
        for one in p:
            q = one @ h
            alpha = np.cbrt(np.linalg.det(q[:, :3]))
            a, _, b = np.linalg.svd(q[:, :3] / alpha)
            rotation.append(a @ np.diag([1, 1, np.linalg.det(a @ b)]) @ b)
            translation.append(q[:, 3] / alpha)
        places = (points[:3] / points[3]).T
        front = np.mean(
            np.all([(places @ r.T + t)[:, 2] > 0 for r, t in zip(rotation, translation, strict=True)], axis=0)
        )
        if best is None or front > best[0]:
            best = front, np.array(rotation), np.array(translation), places
    return best[1:]


# --- (10)-(17) --------------------------------------------------------------------------------------------------------


def groups(xy, camera, feature, n_cameras, focal, th_pt):
    """All groups with TH_pt common points: cameras -> (features, R, t, X, E_R), and the matrix of common points."""
    where = [dict(zip(feature[camera == c], np.flatnonzero(camera == c), strict=True)) for c in range(n_cameras)]
    common = np.array([[len(a.keys() & b.keys()) for b in where] for a in where])
    found = {}
    for cameras in combinations(range(n_cameras), 3):
        shared = sorted(set.intersection(*(set(where[c]) for c in cameras)))
        if len(shared) < th_pt:
            continue
        seen = np.array([[xy[where[c][f]] for f in shared] for c in cameras])
        r, t, x = group(seen)
        error = []
        for j, c in enumerate(cameras):
            y = x @ r[j].T + t[j]
            error.append(np.linalg.norm(y[:, :2] / y[:, 2:] - seen[j], axis=1).mean() * focal[c])
        found[cameras] = (np.array(shared), r, t, x, np.array(error))
    return found, common


def weight(e, n, th_er, xi1=1.0, xi2=1.0):
    """(11)-(13) of the errors (10)."""
    return xi1 * (e[0] + e[1]) / 2 + xi2 / n if max(e) <= th_er else np.inf


def adjacency(found, common, th_er):
    """The lightest of (13): pair -> (weight, group)."""
    lightest = {}
    for cameras, (_, _, _, _, error) in found.items():
        for a, b in combinations(range(3), 2):
            pair = cameras[a], cameras[b]
            w = weight(error[[a, b]], common[pair], th_er)
            if w < lightest.get(pair, (np.inf,))[0]:
                lightest[pair] = w, cameras
    return lightest


def reference(found, n_cameras):
    """The camera that most groups share, the first of equals."""
    return int(np.argmax([sum(c in cameras for cameras in found) for c in range(n_cameras)]))


def shortest(lightest, start, goal, base, n_cameras):
    """The path with the least b^m g by trying every length m: Bellman's table of the least g over exactly m edges."""
    least = [{start: (0.0, (start,))}]
    for _ in range(n_cameras - 1):
        layer = {}
        for here, (g, path) in least[-1].items():
            for (a, b), (w, _) in lightest.items():
                if here in (a, b):
                    there = b if here == a else a
                    if there not in path and g + w < layer.get(there, (np.inf,))[0]:
                        layer[there] = g + w, (*path, there)
        least.append(layer)
    options = [(base**m * layer[goal][0], layer[goal]) for m, layer in enumerate(least) if goal in layer]
    return min(options)[1] if options else None


def motion(one, a, b):
    """The matrix (4,4) that brings camera b's frame to camera a's, in a group: Q_ab."""
    cameras, (_, r, t, _, _) = one
    matrices = []
    for c in (a, b):
        m = np.eye(4)
        m[:3, :3], m[:3, 3] = r[cameras.index(c)], t[cameras.index(c)]
        matrices.append(m)
    return matrices[0] @ np.linalg.inv(matrices[1])


def chained(found, lightest, paths):
    """(16): every camera's matrix (4,4) from the reference's frame to its own."""
    poses = {}
    for camera, (_, path) in paths.items():
        pose = np.eye(4)
        for a, b in pairwise(path):
            cameras = lightest[min(a, b), max(a, b)][1]
            pose = pose @ motion((cameras, found[cameras]), a, b)
        poses[camera] = pose
    return poses


def points(found, common, paths, poses, th_er, n_features):
    """(17): every feature from the lightest group that has it, by that group's camera with the shortest path."""
    out = np.full((n_features, 3), np.nan)

    def total(cameras):
        error = found[cameras][4]
        return sum(weight(error[[a, b]], common[cameras[a], cameras[b]], th_er) for a, b in combinations(range(3), 2))

    for cameras in sorted((c for c in found if np.isfinite(total(c))), key=total, reverse=True):
        placed = [c for c in cameras if c in paths]
        if placed:
            shared, r, t, x, _ = found[cameras]
            camera = min(placed, key=lambda c: (paths[c][0], len(paths[c][1])))
            j = cameras.index(camera)
            back = np.linalg.inv(poses[camera])
            out[shared] = (x @ r[j].T + t[j]) @ back[:3, :3].T + back[:3, 3]
    return out


# --- Algorithm 2 ------------------------------------------------------------------------------------------------------


def projected(x, placement):
    """SPO: each placement's points on the sphere of least squared distances, by Gauss and Newton with halved steps."""
    out = x.copy()
    for p in np.unique(placement):
        rows = (placement == p) & np.isfinite(x[:, 0])
        own = x[rows]
        a = np.column_stack([2 * own, np.ones(len(own))])
        first = np.linalg.lstsq(a, (own**2).sum(axis=1), rcond=None)[0]
        s = np.append(first[:3], np.sqrt(first[3] + first[:3] @ first[:3]))

        def cost(s, own=own):
            return np.sum((np.linalg.norm(own - s[:3], axis=1) - s[3]) ** 2)

        for _ in range(300):
            ray = own - s[:3]
            d = np.linalg.norm(ray, axis=1)
            jacobian = np.column_stack([-ray / d[:, None], -np.ones(len(d))])
            step = -np.linalg.lstsq(jacobian, d - s[3], rcond=None)[0]
            while cost(s + step) > cost(s) and np.linalg.norm(step) > 1e-15 * s[3]:
                step = step / 2
            s = s + step
            if np.linalg.norm(step) < 1e-14 * s[3] or s[3] > 1e3:
                break
        if s[3] > 10 * np.linalg.norm(own - own.mean(axis=0), axis=1).max():
            continue  # a plane
        ray = own - s[:3]
        out[rows] = s[:3] + ray * (s[3] / np.linalg.norm(ray, axis=1))[:, None]
    return out


# --- (2) --------------------------------------------------------------------------------------------------------------

ESTIMATED = [0, 1, 2, 3, 4, 5, 8, 12, 14]  # fu fv u0 v0 k1 k2 k3 s1 s3


def adjusted(poses, intrinsics, x, camera, feature, uv, steps=200):
    """Half the sum of squares at the minimum of (2), by Levenberg and Marquardt; derivatives by differences.

    `poses` (c,4,4), `intrinsics` (c,16), `x` (m,3); `camera`, `feature`, `uv` of each observation.
    """
    n_cameras, width = len(poses), 6 + len(ESTIMATED)
    lens, damping = intrinsics.copy(), 1e-4

    def residuals(poses, lens, x, rows=slice(None)):
        y = np.einsum("nij,nj->ni", poses[camera[rows], :3, :3], x[feature[rows]]) + poses[camera[rows], :3, 3]
        return project(lens[camera[rows]], y) - uv[rows]

    def stepped(poses, lens, dc):
        new = poses.copy()
        for c in range(n_cameras):
            new[c, :3, :3] = cv2.Rodrigues(dc[c, :3])[0] @ poses[c, :3, :3]
            new[c, :3, 3] = poses[c, :3, 3] + dc[c, 3:6]
        lens = lens.copy()
        lens[:, ESTIMATED] += dc[:, 6:]
        return new, lens

    def by_differences():
        size = np.concatenate([np.full(6, 1e-6), np.array([1e-3] * 4 + [1e-6] * 5)])
        jc = np.empty((len(uv), 2, width))
        for k in range(width):
            d = np.zeros((n_cameras, width))
            d[:, k] = size[k]
            jc[:, :, k] = (residuals(*stepped(poses, lens, d), x) - residuals(*stepped(poses, lens, -d), x)) / (
                2 * size[k]
            )
        jp = np.stack(
            [(residuals(poses, lens, x + d) - residuals(poses, lens, x - d)) / 2e-6 for d in 1e-6 * np.eye(3)], axis=2
        )
        return jc, jp

    r = residuals(poses, lens, x)
    cost, growth = 0.5 * np.sum(r**2), 2.0
    for _ in range(steps):
        jc, jp = by_differences()
        while True:
            v = np.zeros((len(x), 3, 3))
            np.add.at(v, feature, jp.transpose(0, 2, 1) @ jp)
            v[:, [0, 1, 2], [0, 1, 2]] *= 1 + damping
            g = np.zeros((len(x), 3))
            np.add.at(g, feature, np.einsum("nij,ni->nj", jp, r))
            inverse = np.linalg.inv(v + 1e-30 * np.eye(3))
            w = np.zeros((len(x), 3, n_cameras, width))
            np.add.at(w.transpose(0, 2, 1, 3), (feature, camera), jp.transpose(0, 2, 1) @ jc)
            w = w.reshape(len(x), 3, -1)
            u, b = np.zeros((n_cameras * width, n_cameras * width)), np.zeros(n_cameras * width)
            for c in range(n_cameras):
                own, j = slice(c * width, (c + 1) * width), jc[camera == c].reshape(-1, width)
                u[own, own], b[own] = j.T @ j, j.T @ r[camera == c].ravel()
            diagonal = np.diag(u).copy()
            s = u + damping * np.diag(diagonal) - np.einsum("pie,pij,pjf->ef", w, inverse, w, optimize=True)
            b = b - np.einsum("pie,pij,pj->e", w, inverse, g, optimize=True)
            s[np.diag_indices_from(s)] += diagonal == 0  # of cameras that see nothing
            scale = 1 / np.sqrt(np.diag(s))
            dc = -scale * np.linalg.solve(s * scale[:, None] * scale, scale * b)
            dx = -np.einsum("pij,pj->pi", inverse, g + w @ dc)
            new = *stepped(poses, lens, dc.reshape(n_cameras, width)), x + dx
            trial = residuals(*new)
            lower = 0.5 * np.sum(trial**2)
            if lower < cost:
                break
            damping, growth = damping * growth, growth * 2
            if damping > 1e12:
                return cost, poses, lens, x
        decrease = (cost - lower) / cost
        (poses, lens, x), r, cost = new, trial, lower
        damping, growth = damping / 5, 2.0
        if decrease < 1e-12:
            break
    return cost, poses, lens, x
