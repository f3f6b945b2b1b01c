"""Null space of the sensitivities: directions in the parameters along which the output does not change.

J holds the output's derivatives in the logarithm of each parameter; its null space is what a perfect trace leaves open
where J is taken. Taken at several places it separates two kinds. What is null everywhere is a scaling symmetry: all
parameters times k to an exponent, and the exponents come out as small whole numbers, C and R of a node, say, as +1 and
-1. Others bend: their exponents depend on the place. What is orthogonal to all of them is a product of parameters that
can be identified.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data.trace import Array
from ambient_trainer.estimation.circuit_structure import CircuitStructure
from ambient_trainer.estimation.structure import linearise

Exponents = dict[str, float]

INSENSITIVE_DEGC = 1e-3
"""What moves the output by less per e-fold does not matter where it is: a resistance that has grown out of sight."""

_PLACES = 6
_NULL = 1e-7
_SAME = 1e-4
_INVOLVED = 0.05
_WHOLE = 0.02
_NEGLIGIBLE = 1e-3


@dataclass(frozen=True)
class Sensitivity:
    """How much the output says of the free parameters' logarithms.

    ``singular_values_degC`` are those of J at the fit, over the root of the number of samples: by how much the output
    moves (RMS, degC) per e-fold along each direction, strongest first. ``blind_directions`` counts the directions that
    move nothing wherever they are looked at, ``symmetries`` are those of them that are scalings, ``products`` what is
    identifiable of the ``mixed`` ones: name to exponent.
    """

    singular_values_degC: tuple[float, ...]
    effect_degC: dict[str, float]
    """Per parameter by how much the output moves (RMS) per e-fold of it alone, at the fit."""
    blind_directions: int
    symmetries: tuple[Exponents, ...]
    products: tuple[Exponents, ...]
    mixed: tuple[str, ...]
    """The parameters that no trace determines by themselves."""
    blind_directions_here: int
    """How many more directions move nothing at the fit, among the parameters that matter there."""
    mixed_here: tuple[str, ...]
    """The parameters that these directions mix."""

    @property
    def insensitive(self) -> tuple[str, ...]:
        """The parameters that do not matter at the fit."""
        return tuple(name for name, effect in self.effect_degC.items() if effect < INSENSITIVE_DEGC)


def sensitivity(structure: CircuitStructure, theta: Array, beta: Array, seed: int = 0) -> Sensitivity:
    """The sensitivity of ``structure`` at theta, beta, and of the structure at places drawn with ``seed``."""
    samples = sum(np.count_nonzero(~np.isnan(segment.outputs)) for segment in structure.segments)
    here = log_jacobian(structure, theta, beta) / math.sqrt(samples)
    random = np.random.default_rng(seed)
    drawn = ((structure.random_start(random), random.uniform(0.2, 0.8, len(beta))) for _ in range(_PLACES))
    places = [log_jacobian(structure, *each) for each in drawn]
    names = parameter_names(structure)
    effect = np.linalg.norm(here, axis=0)
    # the null space where it is smallest, and the mean projector onto it there
    spaces = [_null_space(J) for J in places]
    null_count = min(len(each) for each in spaces)
    projector = np.mean([each.T @ each for each in spaces if len(each) == null_count], axis=0)
    share, directions = np.linalg.eigh(projector)
    symmetries, products = (
        [{name: value for name, value in zip(names, row) if value != 0} for row in _reduced(space.T).tolist()]
        for space in (directions[:, share > 1 - _SAME], directions[:, share < _SAME])
    )
    null_here, mixed_here = _null_here(here, places, effect >= INSENSITIVE_DEGC)
    return Sensitivity(
        singular_values_degC=tuple(np.linalg.svd(here, compute_uv=False).tolist()),
        effect_degC=dict(zip(names, effect.tolist())),
        blind_directions=null_count,
        symmetries=tuple(symmetries),
        products=tuple(each for each in products if len(each) > 1),
        mixed=tuple(name for name, involved in zip(names, np.diag(projector)) if involved > _INVOLVED**2),
        blind_directions_here=null_here,
        mixed_here=tuple(names[index] for index in mixed_here),
    )


def parameter_names(structure: CircuitStructure) -> tuple[str, ...]:
    """The free parameters in the order of the columns of :func:`log_jacobian`; initial states are none of them."""
    return (*structure.search.names, *(each.name for each in structure.linear_parameters))


def log_jacobian(structure: CircuitStructure, theta: Array, beta: Array) -> Array:
    """dy/dlog|p| (r, count) for each free parameter p, in rows with the inner products of all samples'.

    What initial states can make up for is taken out of it.
    """
    _, _, _, free, moved = linearise(structure, theta, beta)
    logarithmic = np.array([name in structure.logarithmic_names for name in structure.search.names], dtype=bool)
    weights = len(structure.linear_parameters)
    J = np.column_stack([moved * np.where(logarithmic, 1.0, theta), free[:, :weights] * beta[:weights]])
    starts = free[:, weights:]
    if starts.shape[1]:
        Q = np.linalg.qr(starts)[0]
        J = J - Q @ (Q.T @ J)
    return J


def _null_space(J: Array) -> Array:
    """An orthonormal basis in rows of the directions of which J says nothing; small columns count as much as large."""
    scale = np.linalg.norm(J, axis=0)
    scale[scale == 0] = 1.0
    _, singular, Vt = np.linalg.svd(J / scale)
    rank = int(np.count_nonzero(singular > _NULL * singular[0])) if len(singular) else 0
    return np.asarray(np.linalg.qr((Vt[rank:] / scale).T)[0].T)


def _null_here(here: Array, places: list[Array], sensitive: NDArray[np.bool_]) -> tuple[int, list[int]]:
    """How many more directions than elsewhere the output at the fit does not follow, and the columns they mix."""
    _, singular, Vt = np.linalg.svd(here[:, sensitive])
    directions = Vt[int(np.count_nonzero(singular >= INSENSITIVE_DEGC)) :]
    more = len(directions) - min(len(_null_space(J[:, sensitive])) for J in places)
    if more <= 0:
        return 0, []
    involved = np.linalg.norm(directions, axis=0) > _INVOLVED
    return more, np.flatnonzero(sensitive)[involved].tolist()


def _reduced(rows: Array) -> Array:
    """The reduced row echelon form, with what is a whole number but for rounding made one."""
    rows = rows.copy()
    done = 0
    for column in range(rows.shape[1]):
        if done == len(rows):
            break
        best = done + int(np.argmax(np.abs(rows[done:, column])))
        if abs(rows[best, column]) < _NEGLIGIBLE:
            continue
        rows[[done, best]] = rows[[best, done]]
        rows[done] /= rows[done, column]
        others = np.arange(len(rows)) != done
        rows[others] -= np.outer(rows[others, column], rows[done])
        done += 1
    whole = np.round(rows)
    return np.where(np.abs(rows - whole) < _WHOLE, whole, rows)[:done]
