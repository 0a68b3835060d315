"""Mock hardware whose calls can be made to fail."""

from hal.mock_hardware import MockHardware


class FailingMock(MockHardware):
    """Mock hardware that records its calls, and raises the error of ``failing`` in a call of that name."""

    def __init__(self, *arguments: object, **options: object) -> None:
        super().__init__(*arguments, **options)
        self.failing: dict[str, Exception] = {}
        self.calls: list[str] = []

    def call(self, name: str) -> None:
        """Record a call, and raise its error."""
        self.calls.append(name)
        if name in self.failing:
            raise self.failing[name]

    def configure(self) -> None:
        self.call("configure")
        super().configure()

    def activate(self) -> None:
        self.call("activate")
        super().activate()

    def cleanup(self) -> None:
        super().cleanup()
        self.call("cleanup")
