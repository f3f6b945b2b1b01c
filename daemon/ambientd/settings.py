"""How the daemon is to run: what a configuration and its model file come to, once they are read and accepted."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from ambient_model.model import Model
from ambientd.publish.access import Access
from ambientd.publish.spec import Spec
from ambientd.sources.spec import Location
from ambientd.sources.supervision import Rules

if TYPE_CHECKING:
    from types import CodeType


class StateSpec(NamedTuple):
    """Where the state is kept over a restart."""

    path: str
    max_age_s: float = 30.0
    """How old it may be; it also lapses with the model's own limit for a gap, whichever comes first."""
    access: Access = Access()


class ReferenceSpec(NamedTuple):
    """Which references of the ambient update the unit's offset, and how far."""

    path: str = ""
    """A file that another program writes; without one only ``ambientd tell`` does."""
    unit: str = "degC"
    sigma_degC: float = 0.5
    """Of a file that holds none."""
    max_age_s: float = 600.0
    correlation_s: float = 3600.0
    """One reading counts in that time."""
    offset_std_degC: float = 0.5
    max_offset_degC: float = 1.0
    forget_days: float = 28.0


class Settings(NamedTuple):
    """How the daemon is to run."""

    source: str
    """The file of this configuration, for messages."""
    model: str
    rate_hz: float = 1.0
    sysfs_root: str = "/sys"
    publish: tuple[Spec, ...] = (Spec("stdout"),)
    level_percent: int = 90
    """The interval that is published as low and high."""
    zones: Mapping[str, str] = MappingProxyType({})
    """Per input name the type of its thermal zone, where it is not the model's."""
    coast_s: float | None = None
    """How long an input may be missing without a fallback; None is as long as a gap is bridged."""
    state: StateSpec | None = None
    zones_by_name: str = "/dev/thermal/tz-by-name"
    """A folder with a link per type to its zone, where there is one."""
    sensors: Mapping[str, Location] = MappingProxyType({})
    """Per input name where it is read, where that is not the model's zone."""
    supervision: Rules = Rules()
    access: Access = Access()
    """Of all that is created, where a publication or the state has none of its own."""
    reference: ReferenceSpec | None = None
    """None where the unit's offset is not learnt."""


class Prepared(NamedTuple):
    """All that a run needs of its files."""

    settings: Settings
    model: Model
    """Without provenance and conformance, which no tick needs."""
    identity: str
    """The model's, where a state is kept: see :func:`ambientd.state.model_identity`."""
    code: "CodeType"
    """Of the usual sample: see :func:`ambientd.fallback.usual_code`."""
