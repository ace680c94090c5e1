"""`spherecal import cameras.txt --format projections -o rig.json`: 3 x 4 projection matrices, as data sets have them.

A line for each camera: its name, width, height, and the twelve numbers of P = K [R t] row by row, in millimetres.
"""

from pathlib import Path

import numpy as np

import spherecal


def read(path: Path) -> list[spherecal.FileCamera]:
    """The cameras of the file, split into K, R and t."""
    cameras = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        words = line.split()
        if len(words) != 15:
            raise spherecal.InputError(f"{path}, line {number}: has {len(words)} words instead of 15.")
        width, height = int(words[1]), int(words[2])
        P = np.array(words[3:], dtype=float).reshape(3, 4)
        # RQ decomposition by QR of the reversed matrix; signs so that focal lengths are above 0
        q, r = np.linalg.qr(P[::-1, :3].T)
        K, R = r.T[::-1, ::-1], q.T[::-1]
        signs = np.sign(np.diag(K))
        K, R = K * signs, signs[:, None] * R
        t = np.linalg.solve(K, P[:, 3])
        if np.linalg.det(R) < 0:
            R, t = -R, -t
        lens = np.zeros(16)
        lens[:4] = K[0, 0] / K[2, 2], K[1, 1] / K[2, 2], K[0, 2] / K[2, 2], K[1, 2] / K[2, 2]
        cameras.append(spherecal.FileCamera(words[0], (width, height), lens, spherecal.Pose(R, t)))
    return cameras


FORMAT = spherecal.ImportFormat("projections", "projection matrices", ("mm", "m"), read)
