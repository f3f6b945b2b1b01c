"""The command's door: nothing is imported before it is known what is wanted."""

import sys


def main() -> int:
    """Run the command line; returns its exit status."""
    from ambientd.cli import call

    return call(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
