"""Any valid model, for hypothesis: ``st.from_type(Model)``."""

import pytest
from hypothesis import strategies as st

from ambient_model.conformance import conformance_of
from ambient_model.model import REGRESSORS, Beyond, Discrete, ErrorVariance, Estimator, Input, Model, Secondary, Term
from documents import anything

PERIODS_S = (0.1, 0.25, 1.0, 2.5, 10.0)

printable = st.characters(exclude_categories=("C", "Z"), include_characters=" ")
texts = st.text(printable, min_size=1, max_size=12)
coefficients = st.floats(-10, 10)


def matrices(rows: int, columns: int) -> st.SearchStrategy[tuple[tuple[float, ...], ...]]:
    row = st.tuples(*[coefficients] * columns)
    return st.tuples(*[row] * rows)


@st.composite
def contractions(draw: st.DrawFn, states: int) -> tuple[tuple[float, ...], ...]:
    """A whose row sums stay below 1, so that it is stable whatever its signs."""
    raw = draw(matrices(states, states))
    scale = draw(st.floats(0, 0.999)) / max([1e-3, *(sum(map(abs, row)) for row in raw)])
    return tuple(tuple(value * scale for value in row) for row in raw)


@st.composite
def inputs(draw: st.DrawFn) -> tuple[Input, ...]:
    names = draw(st.lists(texts, min_size=1, max_size=5, unique=True))
    ranges = st.tuples(st.floats(-300, 0), st.floats(0, 300, exclude_min=True))
    return tuple(Input(name, draw(texts), draw(texts), *draw(ranges)) for name in names)


@st.composite
def quantiles(draw: st.DrawFn) -> dict[int, tuple[float, float]]:
    ends = sorted(draw(st.tuples(*[st.floats(-9, 9)] * 6)))
    return {50: (ends[2], ends[3]), 90: (ends[1], ends[4]), 98: (ends[0], ends[5])}


@st.composite
def estimators(draw: st.DrawFn, read: tuple[Input, ...], periods_s: list[float]) -> Estimator:
    n, m = draw(st.integers(0, 4)), len(read)
    return Estimator(
        inputs=read,
        states=tuple(draw(st.lists(texts, min_size=n, max_size=n, unique=True))),
        discrete=tuple(
            Discrete(period_s, draw(contractions(n)), draw(matrices(n, m)), draw(matrices(1, n)), draw(matrices(1, m)))
            for period_s in periods_s
        ),
        offset=draw(coefficients),
        initial=draw(matrices(n, m)),
        interval=draw(quantiles()),
    )


@st.composite
def spreads(draw: st.DrawFn, known: tuple[str, ...]) -> ErrorVariance:
    term = st.builds(Term, st.sampled_from(known), st.floats(1e-3, 1e5), st.floats(0, 1e3))
    beyond = st.builds(lambda at, more, weight: Beyond(at, at + more, weight), *[st.floats(0, 50)] * 3)
    terms = tuple(draw(st.lists(term, max_size=8)))
    return ErrorVariance(draw(st.floats(0, 100)), terms, draw(quantiles()), draw(st.none() | beyond))


documents = anything(allow_nan=False, allow_infinity=False)
periods = st.lists(st.sampled_from(PERIODS_S), min_size=1, max_size=3, unique=True)


@st.composite
def models(draw: st.DrawFn) -> Model:
    read, periods_s = draw(inputs()), draw(periods)
    names = [each.name for each in read]
    dispensable = draw(st.lists(st.sampled_from(names), unique=True)) if len(names) > 1 else []
    main = draw(estimators(read, periods_s))
    guards = st.builds(Secondary, estimators(read, periods_s), st.floats(0, 20, exclude_min=True))
    guard = draw(st.none() | guards)
    rows = draw(st.lists(st.tuples(*[st.floats(-40, 90)] * len(read)), min_size=1, max_size=4))
    return Model(
        name=draw(texts),
        created=draw(texts),
        output=draw(texts),
        main=main,
        fallbacks={
            name: draw(estimators(tuple(each for each in read if each.name != name), periods_s)) for name in dispensable
        },
        provenance=draw(st.dictionaries(st.text(max_size=5), documents, max_size=3)),
        conformance=conformance_of(main, tuple(rows)),
        secondary=guard,
        error_variance=draw(st.none() | spreads(REGRESSORS if guard is not None else REGRESSORS[:1])),
    )


st.register_type_strategy(Model, models())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> str:
    """One folder for all examples of a property."""
    return str(tmp_path_factory.mktemp("files"))
