"""A strain of the ball that is the same in space at all placements, as its weight makes it, however the ball is turned.

It is no change of the ball from one placement to the next. Where cameras look mostly in one direction, lenses and poses
make up for a strain along it: the data know it to 4e-6 in other directions, in this one to 6e-5 (rig B) or 2.4e-4 (ten
cameras at random), where a ball of 500 mm that is flattened by 0.1 mm has 2e-4.
"""

import numpy as np

from spherecal.adjust.camera_effects import Design
from spherecal.adjust.variance_components import Effects, others_eliminated
from spherecal.base.arrays import FloatArray

# A ball that is flattened by 0.05 mm: of 96 flattened by 0.1 and 0.3 mm (rig B, hall12, random) 67 had cameras that
# were off by more than 3 U, by up to 38 U, without this. In a direction that the data know less well than that it may
# be more, up to 0.1 mm, so that U holds 0.2 mm: 5 of 32 flattened by 0.3 mm had (random, up to 7.6 U) with 0.05 mm
# there too. More costs: with 0.15 mm realistic recording 9210 has U of 50 mm on 500 where 12 are its own.
PRIOR, MOST_PRIOR = 1e-4, 2e-4
# A strain known less well than this is not believed: lenses beyond their model show 0.2 to 50 %.
MOST_SD = 1e-3
# Strains that keep the volume, (5,3,3), of the same norm as one of 1 along an axis.
STRAINS = np.zeros((5, 3, 3))
STRAINS[0], STRAINS[1] = np.diag([1.0, -1.0, 0.0]), np.diag([-0.5, -0.5, 1.0])
for _k, (_i, _j) in enumerate(((0, 1), (0, 2), (1, 2)), start=2):
    STRAINS[_k, _i, _j] = STRAINS[_k, _j, _i] = 1.0
STRAINS *= np.sqrt(1.5) / np.linalg.norm(STRAINS, axis=(1, 2))[:, None, None]


def strain_columns(design: Design, placement_rotation: FloatArray, is_stored: bool) -> FloatArray:
    """The coefficients (m,5) of all effects that make up each of `STRAINS`: linear changes of the ball's shape.

    What they have in common is the ball's own shape, all of it where the ball was not turned, unless that is stored:
    of the strain in which it was found, by other placements or in another rig, a stored shape says nothing.
    """
    assert design.bending is not None
    linear, unit = design.bending.linear
    of_ball = np.einsum("tji,kjl,tlm->timk", placement_rotation, STRAINS, placement_rotation)
    if not is_stored:
        of_ball -= of_ball.mean(axis=0)
    columns = np.zeros((design.bending.n_placements, 3, design.bending.values.shape[1], len(STRAINS)))
    columns[:, :, linear] = of_ball * unit[:, None]
    out = np.zeros((design.count, len(STRAINS)))
    out[design.n_of_cameras :] = columns.reshape(-1, len(STRAINS))
    return out


def strain_variance(effects: Effects, variances: FloatArray, columns: FloatArray, sigma0_squared: float) -> FloatArray:
    """The mean products (5,5), over sigma0 squared, of strains that may exist beside effects of variances (parts,).

    Of each direction that the data know by itself: the square of the estimate, less its variance, and what they leave
    of `PRIOR`, by the share that they leave: a strain that they know shows itself. Where they know it less well, the
    most that any variance up to theirs leaves.
    """
    by = effects.matrix @ columns
    part = np.append(effects.part, np.full(len(STRAINS), len(variances)))
    both = Effects(
        np.block([[effects.matrix, by], [by.T, columns.T @ by]]),
        np.append(effects.gradient, columns.T @ effects.gradient),
        effects.squares, effects.redundancy, part, np.append(effects.kind, -1),
    )  # fmt: skip
    alone = others_eliminated(both, np.append(variances, 0.0), np.arange(len(variances) + 1) == len(variances))
    information, direction = np.linalg.eigh(alone.matrix / sigma0_squared)
    known = 1 / information.clip(min=1.0)
    value = -known * (direction.T @ alone.gradient) / sigma0_squared
    prior = known.clip(PRIOR**2, MOST_PRIOR**2)
    left = 1 / (1 / prior + 1 / known)
    size = left**2 / prior + np.maximum(value**2 - known, 0.0) * (known < MOST_SD**2)
    return (direction * size) @ direction.T / sigma0_squared
