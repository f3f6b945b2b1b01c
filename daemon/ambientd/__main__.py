"""The command's door: nothing is imported before it is known what is wanted."""

import io
import sys


def main() -> int:
    """Run the command line; returns its exit status."""
    from ambientd.cli import call

    if isinstance(sys.stdout, io.TextIOWrapper):  # a name may hold letters that this locale does not know
        sys.stdout.reconfigure(errors="backslashreplace")
    return call(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
