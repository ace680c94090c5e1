"""The target family: its code book, its distances, its self-ambiguity, and the origin of a target in space."""

import itertools

import numpy as np
import pytest

from docs.make_code_book import admissible_triples, generate_codes, lattice
from spherecal.base.errors import InputError
from spherecal.geometry.rotation import exp_rotation
from spherecal.targets.centre import target_centre
from spherecal.targets.family import CODE_COUNT, DOTS, TEMPLATE_MM, code_book, make_target_set


def all_dots() -> np.ndarray:
    """The eight dots of all codes, (344, 8, 2) mm."""
    template = np.broadcast_to(TEMPLATE_MM, (CODE_COUNT, 5, 2))
    return np.concatenate([template, code_book()], axis=1)


def test_generator_reproduces_the_kept_code_book():
    np.testing.assert_array_equal(generate_codes(), code_book())


def test_lattice_and_triples_have_the_numbers_known_for_this_template():
    assert len(lattice()) == 52
    assert len(admissible_triples(lattice())) == 15416 - 44  # less those with two dots as far apart as A and E


def test_dots_keep_their_distance_and_a_e_are_the_farthest():
    dots = all_dots()
    for i, j in itertools.combinations(range(8), 2):
        distance = np.linalg.norm(dots[:, i] - dots[:, j], axis=1)
        assert distance.min() >= 5.0 - 1e-9
        if (i, j) != (0, 4):
            assert distance.max() < np.linalg.norm(TEMPLATE_MM[0] - TEMPLATE_MM[4]) - 0.5
    assert np.abs(dots).max() <= 10.0


def test_first_200_codes_are_the_open_ones():
    dots = all_dots()[:200]
    distance = np.linalg.norm(dots[:, :, None] - dots[:, None], axis=3)
    assert distance[distance > 0].min() > 5.59


def test_two_codes_share_at_most_one_dot():
    codes = [frozenset(map(tuple, code)) for code in code_book()]
    assert len(codes) == CODE_COUNT == 344
    assert max(len(a & b) for a, b in itertools.combinations(codes, 2)) == 1


def test_no_wrong_reading_looks_like_a_code():
    """Independent of the generator: no five dots taken for A..E by an affine view leave a triple near the lattice."""
    readings = np.array(list(itertools.permutations(range(8), 5)))[1:]
    rest = np.array([sorted(set(range(8)) - set(reading)) for reading in readings])
    places = lattice()
    for dots in all_dots()[::29]:
        five = np.concatenate([dots[readings], np.ones((len(readings), 5, 1))], axis=2)
        gram = np.einsum("nij,nik->njk", five, five)
        regular = np.abs(np.linalg.det(gram)) > 1e-3
        maps = np.linalg.solve(gram[regular], np.einsum("nij,ik->njk", five[regular], TEMPLATE_MM))
        misfit = np.sqrt(((five[regular] @ maps - TEMPLATE_MM) ** 2).sum(axis=(1, 2)) / 5)
        linear = maps[:, :2]
        singular = np.linalg.svd(linear, compute_uv=False)
        plausible = (misfit < 0.75) & (np.linalg.det(linear) > 0) & (singular[:, 1] / singular[:, 0] > 0.174)
        for affine, others in zip(maps[plausible], rest[regular][plausible], strict=True):
            seen = np.column_stack([dots[others], np.ones(3)]) @ affine
            assert np.linalg.norm(seen[:, None] - places, axis=2).min(axis=1).max() > 1.8 - 1e-3


def test_template_divides_its_diagonal_as_the_decoder_expects():
    a, b, c, d, e = TEMPLATE_MM
    np.testing.assert_allclose(a + 0.625 * (e - a), d)
    np.testing.assert_allclose(a + 0.75 * (e - a), (b + c) / 2)


def test_target_set_scales_and_numbers_its_targets():
    full, half = make_target_set(200), make_target_set(3, size_mm=14.0, polarity="dark-on-light", start_id=7)
    assert list(full.layouts) == list(range(1, 201))
    assert list(half.layouts) == [7, 8, 9]
    assert (full.dot_diameter_mm, half.dot_diameter_mm) == (3.0, 1.5)
    assert (full.polarity, half.polarity) == ("light-on-dark", "dark-on-light")
    assert tuple(half.layouts[7]) == DOTS
    np.testing.assert_allclose(half.places(8, DOTS), full.places(8, DOTS) / 2)
    assert np.linalg.norm(np.diff(full.places(1, ["A", "E"]), axis=0)) == pytest.approx(20 * np.sqrt(2))


def test_code_dots_are_named_row_by_row():
    for code in code_book():
        assert sorted(map(tuple, code[:, ::-1])) == list(map(tuple, code[:, ::-1]))


@pytest.mark.parametrize(("count", "start"), [(345, 1), (0, 1), (1, 0), (10, 340)])
def test_ids_the_family_does_not_have_are_refused(count, start):
    with pytest.raises(InputError, match="1 to 344"):
        make_target_set(count, start_id=start)


@pytest.mark.parametrize("dots", [slice(None), [0, 1, 2, 3], [0, 3, 4, 7], [1, 5, 6, 7]])
def test_centre_is_the_origin_of_the_layout(dots):
    rng = np.random.default_rng(2)
    for target, layout in make_target_set(40).layouts.items():
        flat = np.array([[*layout[dot], 0.0] for dot in DOTS])
        turn, shift = exp_rotation(rng.normal(size=3) * 2), rng.normal(size=3) * 500
        space = flat @ turn.T + shift
        centre = target_centre(flat[dots, :2], space[dots])
        assert centre is not None, target
        np.testing.assert_allclose(centre, shift, atol=1e-9)


def test_centre_uses_no_scale_and_equal_weights():
    flat = np.column_stack([make_target_set(1).places(1, DOTS), np.zeros(8)])
    grown = target_centre(flat[:, :2], flat * 1.001 + [0, 0, 7])
    assert grown is not None
    # without a scale the means coincide, so the origin misses by 0.001 of their offset
    np.testing.assert_allclose(grown, [0, 0, 7] + 0.001 * flat.mean(axis=0), atol=1e-12)


def test_centre_of_too_few_or_collinear_dots_is_absent():
    flat = make_target_set(1).places(1, DOTS)
    assert target_centre(flat[:3], np.column_stack([flat[:3], np.zeros(3)])) is None
    line = np.array([[0.0, 5.0], [5.0, 5.0], [10.0, 5.0], [-5.0, 5.0]])
    assert target_centre(line, np.column_stack([line, np.zeros(4)])) is None
    through_origin = line - [0.0, 5.0]
    centre = target_centre(through_origin, np.column_stack([through_origin, np.ones(4)]))
    assert centre is not None
    np.testing.assert_allclose(centre, [0, 0, 1], atol=1e-12)
