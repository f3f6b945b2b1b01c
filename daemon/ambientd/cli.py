"""The command line: status 0 is done, 1 the work failed, 2 the call was wrong, and a message explains it.

Each command imports what it needs when it runs: a replay pays neither memory nor time for sockets.
"""

import argparse
import os
from collections.abc import Callable, Sequence
from typing import Any

from ambient_model import __version__
from ambientd.config import RATE_RANGE_HZ, load_settings, publishing_to, settings_for_model
from ambientd.exit_status import status_of
from ambientd.handover import prepare
from ambientd.publish.spec import Spec, kinds, parse
from ambientd.settings import Prepared, Settings
from ambientd.sources.quantities import REFERENCE_RANGE_DEGC, SIGMA_RANGE_DEGC

_CONFIG = "/etc/ambientd/ambientd.yaml"


def call(arguments: Sequence[str]) -> int:
    """Run the command that ``arguments`` name; returns the exit status. Raises SystemExit(2) for a wrong call."""
    parser = _parser()
    options = parser.parse_args(arguments)
    return status_of(lambda: options.command(parser, options))


def prepared(arguments: Sequence[str]) -> Prepared:
    """What ``run`` from the sensors needs of its files; raises SystemExit, and :class:`Refused`."""
    parser = _parser()
    options = parser.parse_args(arguments)
    _check_pace(parser, options)
    return _prepared(options)


class _Help(argparse.HelpFormatter):
    """As wide as the terminal. To find that out argparse imports shutil, 0.8 MB, where no help is asked for, too."""

    def __init__(self, prog: str) -> None:
        try:
            columns = int(os.environ.get("COLUMNS", 0)) or os.get_terminal_size(1).columns
        except (ValueError, OSError):
            columns = 0
        super().__init__(prog, width=(columns or 80) - 2)


class _Parser(argparse.ArgumentParser):
    """Formats with :class:`_Help`, and so do its commands; lists the kinds of publishers where help is asked for."""

    def __init__(self, **options: Any) -> None:
        super().__init__(formatter_class=_Help, **options)

    def format_help(self) -> str:
        """The help text."""
        if self.get_default("command") is _run:
            self.epilog = f"kinds of publishers: {', '.join(kinds())}"
        return super().format_help()


def _parser() -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = _Parser(
        prog="ambientd",
        description="Estimate the temperature of the air around a device from the temperatures inside it.",
    )
    parser.add_argument("--version", action="version", version=f"ambientd {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    _add_run(commands)
    _add_replay(commands)
    _add_check(commands)
    _add_submit(commands)
    watch = commands.add_parser("watch", help="follow a running daemon's socket, and the next one's, a line a tick")
    watch.add_argument("socket", metavar="SOCKET")
    watch.add_argument(
        "--stale-after",
        metavar="S",
        type=_number(0.1, 1e6),
        default=15.0,  # the slowest daemon ticks every 10 s
        help="warn when no line has come for S seconds (default: 15)",
    )
    watch.set_defaults(command=_watch)
    return parser


_Commands = argparse._SubParsersAction  # argparse has no public name for what add_subparsers returns


def _add_run(commands: "_Commands[argparse.ArgumentParser]") -> None:
    run = commands.add_parser("run", help="estimate from the thermal zones, or from a replayed trace, and publish")
    _add_origin(run)
    run.add_argument(
        "--publish",
        metavar="KIND:PATH",
        type=_spec,
        action="append",
        help="where to; repeatable (default: stdout)",
    )
    run.add_argument("--replay", metavar="TRACE", help="read this trace, at its own pace, instead of the thermal zones")
    pace = run.add_mutually_exclusive_group()
    pace.add_argument(
        "--rate",
        metavar="HZ",
        type=_number(RATE_RANGE_HZ[0], 1e6),
        help="samples a second (default: 1); with --replay, rows a second instead of the trace's own pace",
    )
    pace.add_argument(
        "--speed",
        metavar="N",
        type=_number(0, 1e6),
        help="with --replay: N times as fast as the trace; 0 is as fast as it goes (default: 1)",
    )
    run.set_defaults(command=_run)


def _add_replay(commands: "_Commands[argparse.ArgumentParser]") -> None:
    replay = commands.add_parser("replay", help="run a trace through a model, as fast as it goes, into a file")
    replay.add_argument("model", metavar="MODEL.json")
    replay.add_argument("trace", metavar="TRACE.csv")
    replay.add_argument("-o", "--output", metavar="OUT.csv", required=True)
    replay.add_argument("--from", dest="from_s", metavar="S", type=float, help="leave out what is earlier")
    replay.add_argument("--to", dest="to_s", metavar="S", type=float, help="leave out this time and what is later")
    replay.set_defaults(command=_replay)


def _add_check(commands: "_Commands[argparse.ArgumentParser]") -> None:
    check = commands.add_parser("check", help="verify a model file, its sensors and its outputs")
    _add_origin(check)
    check.set_defaults(command=_check)
    withdraw = commands.add_parser("withdraw", help="after a killed daemon: remove its outputs, or leave their poison")
    withdraw.add_argument("--config", metavar="FILE", required=True)
    withdraw.set_defaults(command=_withdraw)


def _add_submit(commands: "_Commands[argparse.ArgumentParser]") -> None:
    submit = commands.add_parser(
        "tell",
        help="hand the running daemon a reading of the ambient, from which it learns this unit's offset",
        description="Hand the running daemon a reading of the ambient. It counts in the status tracking or degraded,"
        " once per correlation time, where it lies within 3 sigma; the answer is printed. Status 1: it did not count.",
    )
    submit.add_argument("value_degC", metavar="DEGC", type=_number(*REFERENCE_RANGE_DEGC), help="the ambient, in degC")
    submit.add_argument(
        "--sigma",
        metavar="DEGC",
        type=_number(*SIGMA_RANGE_DEGC),
        help="how uncertain the reading is, a standard deviation (default: the configuration's, 0.5)",
    )
    submit.add_argument("--config", metavar="FILE", default=_CONFIG, help=f"the daemon's (default: {_CONFIG})")
    submit.set_defaults(command=_submit)


def _add_origin(command: argparse.ArgumentParser) -> None:
    origin = command.add_mutually_exclusive_group(required=True)
    origin.add_argument("--config", metavar="FILE", help="a YAML configuration, or JSON where it ends with .json")
    origin.add_argument("--model", metavar="MODEL.json", help="a model file, with every setting at its default")
    command.add_argument("--sysfs-root", metavar="DIR", help="where sysfs is (default: /sys)")


def _number(low: float, high: float) -> Callable[[str], float]:
    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is not between {low:g} and {high:g}")
        return value

    return number


def _spec(text: str) -> Spec:
    try:
        return parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _settings(options: argparse.Namespace) -> Settings:
    settings = load_settings(options.config) if options.config else settings_for_model(options.model)
    if options.sysfs_root is not None:
        settings = settings._replace(sysfs_root=options.sysfs_root)
    return settings


def _check_pace(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    if options.speed is not None and options.replay is None:
        parser.error("--speed goes with --replay")
    if options.replay is None and options.rate is not None and options.rate > RATE_RANGE_HZ[1]:
        parser.error(f"argument --rate: {options.rate:g} is not between {RATE_RANGE_HZ[0]:g} and {RATE_RANGE_HZ[1]:g}")


def _settings_to_run(options: argparse.Namespace) -> Settings:
    """The configuration as it is now, with the call's overrides."""
    settings = _settings(options)
    return publishing_to(settings, options.publish) if options.publish else settings


def _prepared(options: argparse.Namespace) -> Prepared:
    settings = _settings_to_run(options)
    return prepare(settings._replace(rate_hz=options.rate or settings.rate_hz))


def _run(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    _check_pace(parser, options)
    from ambientd.run import run_replayed, run_sensors

    if options.replay is None:
        return run_sensors(lambda: _prepared(options), lambda: _prepared(options))
    speed = 1.0 if options.speed is None else options.speed
    run_replayed(_settings_to_run(options), options.replay, options.rate, speed)


def _replay(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    from ambientd.replay import replay

    written = replay(options.model, options.trace, options.output, options.from_s, options.to_s)
    print(f"{options.output}: {written}")


def _check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    from ambientd.check import (
        check_all,
        check_consumers,
        check_files,
        check_outlets,
        check_reference,
        check_sensors,
        report_sensors,
    )

    settings = _settings(options)
    check_files(settings)
    # a model file alone may be checked on a host; a configuration or a root means that this is the device
    if options.config is None and options.sysfs_root is None:
        report_sensors(settings)
    else:
        check_all(settings, (check_sensors, check_outlets, check_reference, check_consumers))


def _withdraw(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    from ambientd.run import withdraw

    withdraw(load_settings(options.config))


def _submit(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    from ambientd.submit import submit

    submit(load_settings(options.config), options.value_degC, options.sigma)


def _watch(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    from ambientd.watch import watch

    watch(options.socket, options.stale_after)
