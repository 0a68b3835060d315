"""Run the ``servoloop`` command with ``python -m servoloop``."""

from servoloop.cli import main

if __name__ == "__main__":
    main()
