import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.model import Discrete, Estimator
from ambient_model.recursion import advance, equilibrium, is_stable, output, settling_steps, spectral_norms

random = np.random.default_rng(4)


@given(st.from_type(Estimator), st.data())
def test_the_pieces_are_the_matrix_products(estimator: Estimator, data: st.DataObject) -> None:
    n, m = len(estimator.states), len(estimator.inputs)
    x = data.draw(st.tuples(*[st.floats(-100, 100)] * n))
    u = data.draw(st.tuples(*[st.floats(-100, 100)] * m))
    for discrete in estimator.discrete:
        A, B = np.reshape(discrete.A, (n, n)), np.reshape(discrete.B, (n, m))
        y = np.reshape(discrete.C, n) @ x + np.reshape(discrete.D, m) @ u + estimator.offset
        assert output(discrete, estimator.offset, x, u) == pytest.approx(float(y), rel=1e-12, abs=1e-9)
        np.testing.assert_allclose(advance(discrete, x, u), A @ x + B @ u, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(
        equilibrium(estimator.initial, u), np.reshape(estimator.initial, (n, m)) @ u, rtol=1e-12, atol=1e-9
    )


def with_eigenvalues(*eigenvalues: complex, transform: np.ndarray | None = None) -> tuple[tuple[float, ...], ...]:
    """A real matrix; a complex eigenvalue stands for its pair."""
    blocks = [
        np.array([[z.real, z.imag], [-z.imag, z.real]]) if isinstance(z, complex) else np.array([[z]])
        for z in eigenvalues
    ]
    size = sum(len(block) for block in blocks)
    J, at = np.zeros((size, size)), 0
    for block in blocks:
        J[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    # drawn anew each time: whichever test comes first, each has its own
    T = np.random.default_rng(size).normal(size=(size, size)) if transform is None else transform
    return tuple(map(tuple, (T @ J @ np.linalg.inv(T)).tolist()))


def turn(radius: float, angle: float) -> complex:
    return complex(radius * math.cos(angle), radius * math.sin(angle))


@pytest.mark.parametrize(
    ("eigenvalues", "stable"),
    [
        ((0.0,), True),
        ((0.5, 0.9, -0.99), True),
        ((1 - 1e-7,), True),
        ((1 - 1e-7, 0.3, 0.2), True),
        ((turn(1 - 1e-7, 0.3), 0.2), True),
        ((1.0,), False),
        ((-1.0, 0.1), False),
        ((1.0, 0.9, 0.5), False),
        ((1 + 1e-7, 0.2), False),
        ((turn(1.0, 0.7), 0.4), False),
        ((turn(1.001, 2.0), 0.4), False),
        ((turn(3.0, 1.0), 0.4), False),
        ((1e200, 0.1), False),
    ],
)
def test_stability_is_that_of_the_eigenvalues(eigenvalues: tuple[complex, ...], stable: bool) -> None:
    assert is_stable(with_eigenvalues(*eigenvalues)) is stable


def test_a_circuit_that_loses_nothing_is_never_stable() -> None:
    """Rows that sum to 1, an eigenvalue of exactly 1: rounding alone makes a high power of some of them vanish."""
    for size in (2, 3, 4):
        for _ in range(50):
            A = random.uniform(size=(size, size))
            A /= A.sum(axis=1, keepdims=True)
            assert not is_stable(tuple(map(tuple, A.tolist())))


def test_a_long_shear_is_stable_all_the_same() -> None:
    assert is_stable(((0.5, 1e60), (0.0, 0.5)))


def test_norms_are_those_of_the_doubled_powers() -> None:
    A = with_eigenvalues(0.97, turn(0.9, 1.0))
    wanted = [np.linalg.norm(np.linalg.matrix_power(np.array(A), 2**k), np.inf) for k in range(6)]
    assert spectral_norms(A, 5) == pytest.approx(wanted, rel=1e-9)
    assert spectral_norms(((1e60,),), 5) == [1e60, pytest.approx(1e120)]
    assert spectral_norms(((0.0, 1.0), (0.0, 0.0)), 5) == [1.0, 0.0]


@pytest.mark.parametrize("remainder", [0.5, 0.05, 1e-6])
@pytest.mark.parametrize("slowest", [0.01, 0.4, 0.9, 0.999, 0.99999])
def test_settling_against_matrix_powers(slowest: float, remainder: float) -> None:
    A = with_eigenvalues(slowest, slowest / 2, turn(slowest / 3, 1.0))
    steps = settling_steps(A, remainder)
    norms = [np.abs(np.linalg.matrix_power(np.array(A), k)).sum(axis=1).max() for k in (steps, steps - 1)]
    assert norms[0] <= remainder * (1 + 1e-9)
    assert steps == 1 or norms[1] > remainder * (1 - 1e-9)


def test_what_never_settles_takes_for_ever_and_without_states_no_time() -> None:
    assert settling_steps(((1.0,),), 0.05) == 2**40
    assert settling_steps((), 0.05) == 0
    assert is_stable(())


def test_products_are_added_from_left_to_right_on_every_interpreter() -> None:
    """1e16 + 1 is 1e16: a sum that compensates, as the built-in one does since Python 3.12, would give 1.0."""
    assert advance(Discrete(1.0, ((1e16,),), ((1.0, -1e16),), ((0.0,),), ((0.0, 0.0),)), [1.0], [1.0, 1.0]) == [0.0]
    assert equilibrium(((1e16, 1.0, -1e16),), [1.0, 1.0, 1.0]) == [0.0]
    assert output(Discrete(1.0, ((0.0,),), ((0.0, 0.0),), ((1e16,),), ((1.0, -1e16),)), 2.0, [1.0], [1.0, 1.0]) == 2.0
