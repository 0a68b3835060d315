"""``python -m servoloop`` is the same as ``servoloop``."""

from servoloop.cli import main

if __name__ == "__main__":
    main()
