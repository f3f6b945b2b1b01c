from cmath import rect

import numpy as np
import pytest
from scipy.linalg import block_diag

from ambient_model.model import Discrete
from ambient_model.recursion import advance, equilibrium, is_stable, output, settling_steps

random = np.random.default_rng(4)


def with_eigenvalues(*eigenvalues: complex) -> tuple[tuple[float, ...], ...]:
    """A real matrix; a complex eigenvalue stands for its pair."""
    J = block_diag(*([[z.real, z.imag], [-z.imag, z.real]] if isinstance(z, complex) else [[z]] for z in eigenvalues))
    T = np.random.default_rng(len(J)).normal(size=J.shape)
    return tuple(map(tuple, (T @ J @ np.linalg.inv(T)).tolist()))


STABLE = ((0.0,), (0.5, 0.9, -0.99), (1 - 1e-7,), (1 - 1e-7, 0.3, 0.2), (rect(1 - 1e-7, 0.3), 0.2))
UNSTABLE = ((1.0,), (-1.0, 0.1), (1.0, 0.9, 0.5), (1 + 1e-7, 0.2), (1e200, 0.1))
UNSTABLE_PAIRS = ((rect(1.0, 0.7), 0.4), (rect(1.001, 2.0), 0.4), (rect(3.0, 1.0), 0.4))


@pytest.mark.parametrize(
    ("eigenvalues", "stable"),
    [*((each, True) for each in STABLE), *((each, False) for each in UNSTABLE + UNSTABLE_PAIRS)],
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


@pytest.mark.parametrize("remainder", [0.5, 0.05, 1e-6])
@pytest.mark.parametrize("slowest", [0.01, 0.4, 0.9, 0.999, 0.99999])
def test_settling_against_matrix_powers(slowest: float, remainder: float) -> None:
    A = with_eigenvalues(slowest, slowest / 2, rect(slowest / 3, 1.0))
    steps = settling_steps(A, remainder)
    norms = [np.abs(np.linalg.matrix_power(np.array(A), k)).sum(axis=1).max() for k in (steps, steps - 1)]
    assert norms[0] <= remainder * (1 + 1e-9)
    assert steps == 1 or norms[1] > remainder * (1 - 1e-9)


def test_what_never_settles_takes_for_ever_and_without_states_no_time() -> None:
    assert settling_steps(((1.0,),), 0.05) == 2**40
    assert settling_steps((), 0.05) == 0
    assert is_stable(())
    assert is_stable(((0.5, 1e60), (0.0, 0.5))), "a long shear"


def test_products_are_added_from_left_to_right_on_every_interpreter() -> None:
    """1e16 + 1 is 1e16: a sum that compensates, as the built-in one does since Python 3.12, would give 1.0."""
    assert advance(Discrete(1.0, ((1e16,),), ((1.0, -1e16),), ((0.0,),), ((0.0, 0.0),)), [1.0], [1.0, 1.0]) == [0.0]
    assert equilibrium(((1e16, 1.0, -1e16),), [1.0, 1.0, 1.0]) == [0.0]
    assert output(Discrete(1.0, ((0.0,),), ((0.0, 0.0),), ((1e16,),), ((1.0, -1e16),)), 2.0, [1.0], [1.0, 1.0]) == 2.0
