"""Programming errors that a stack has survived. The stack logs each of them with a traceback."""

import logging
from types import TracebackType
from typing import Final

from servoloop.simulation.stack_faults import InjectedError

LOGGER: Final = "servoloop"
"""Logger of the whole stack."""


class LoggedDefects(logging.Handler):
    """Context that keeps the first exception that the stack logs with a traceback. Injected errors do not count.

    The context also receives errors while logging is disabled. These errors are still not printed.
    """

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.text = ""
        """Description of the first exception, or an empty string if there was none."""
        self._logger = logging.getLogger(LOGGER)
        self._before = (0, True)
        """Level up to which logging is disabled outside the context, and whether the logger propagates messages."""

    def emit(self, record: logging.LogRecord) -> None:
        """Keep the exception of a log record."""
        error = record.exc_info[1] if record.exc_info else None
        if error is not None and not self.text and not _injected(error):
            self.text = f"internal error: {record.getMessage()}: {error!r}"

    def __enter__(self) -> "LoggedDefects":
        disabled = logging.root.manager.disable
        self._before = disabled, self._logger.propagate
        if disabled >= logging.ERROR:
            logging.disable(logging.WARNING)
            self._logger.propagate = False
        self._logger.addHandler(self)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._logger.removeHandler(self)
        disabled, self._logger.propagate = self._before
        logging.disable(disabled)


def _injected(error: BaseException | None) -> bool:
    """Return whether an exception or one of its causes was injected."""
    while error is not None:
        if isinstance(error, InjectedError):
            return True
        error = error.__cause__
    return False
