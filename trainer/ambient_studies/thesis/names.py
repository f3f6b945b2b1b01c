"""What the tables call methods, variants and scenarios, and which of the thesis's tables holds which scenario."""

from ambient_studies.thesis.published import MODELS

RELATED = {
    "chau_linear_battery": "Chau 2019, linear battery",
    "he_svr": "He et al. 2020, support vectors",
    "ishii_transfer_functions": "Ishii, Nakashima 2017, transfer functions",
    "li_fixed_point": "Li et al. 2020, fixed point",
}

OURS = {
    "circuit_observer": "Ours: circuit observer",
    "free_observer": "Ours: free observer",
}
"""Neither in the thesis nor in its related work."""

VARIANTS = {
    "corrected": "corrected",
    "as_printed": "as printed",
    "noncausal": "non-causal",
    "published_parameters": "published parameters",
    "ours": "ours",
}

SCENARIOS = {
    "4": "Scenario 4: verification, ambient and CPU load change",
    "1": "Scenario 1: idle at 20 °C",
    "2.1": "Scenario 2.1: all cores loaded at 20 °C",
    "3": "Scenario 3: ambient from -10 to 50 °C",
    "2.3": "Scenario 2.3: camera",
    "2.4": "Scenario 2.4: video over 4G",
    "2.2": "Scenario 2.2: charging",
    "2.5": "Scenario 2.5: all cores loaded at 50 °C",
}
"""In the order of the thesis's tables, which hold no figures of the last two."""

TABLES = {"4": (1, 2), "1": (3, 4), "2.1": (5, 6), "3": (7, 8), "2.3": (9, 10), "2.4": (11, 12)}
"""By scenario the numbers of its tables in chapter 5: errors, and intervals."""


def method_name(model: str) -> str:
    """The thesis's name, or the related method's, or ours."""
    return {**MODELS, **RELATED, **OURS}.get(model, model)
