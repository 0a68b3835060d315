"""The echo of a line: half-duplex adapters that join the two wires give back what we send. Which do is learnt."""


class Echo:
    """What is known of one port; shared by everything that reads from it."""

    def __init__(self) -> None:
        self.present: bool | None = None
        """None until an answer has shown it."""

    def expected(self, sent: bytes) -> int:
        """How many bytes of our own come before the answer."""
        return len(sent) if self.present else 0

    def strip(self, sent: bytes, data: bytes) -> bytes:
        """``data`` without our own bytes and what came before them."""
        if self.present is False:
            return data
        at = data.find(sent)
        if at < 0:
            self.present = None
            return data
        self.present = True
        return data[at + len(sent) :]
