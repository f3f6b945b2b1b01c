"""``python -m ambient_trainer``."""

from ambient_trainer.cli.main import main

if __name__ == "__main__":
    main()
