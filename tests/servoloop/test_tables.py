"""Tables are not truncated in narrow terminals."""

from collections import Counter
from io import StringIO

import pytest
from rich.console import Console
from rich.table import Table

from commissioning.doctor.report import BusFigures, DoctorReport, ServoFigures
from servoloop.commands.doctor import print_report
from servoloop.commands.shared.console import print_table

ARMS = [f"joint{number}" for number in range(1, 7)] + ["hand_right_joint"]


def printed(width: int, table: Table, *texts: str) -> str:
    console = Console(file=StringIO(), width=width)
    print_table(console, table, *texts)
    return console.file.getvalue()  # type: ignore[attr-defined,no-any-return]


def test_the_doctors_table_fits_into_80_columns() -> None:
    servos = tuple(
        ServoFigures(name, servo_id, "sts3215_c001", "well", None, -1.683, (12.0, 12.1), 27.0, 0.1, True, ("overload",))
        for servo_id, name in enumerate(ARMS, 1)
    )
    bus = BusFigures("", "/dev/ttyACM0", 1_000_000, None, None, servos, ())
    console = Console(file=StringIO(), width=80)
    print_report(DoctorReport((), (bus,)), console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "…" not in text and max(map(len, text.splitlines())) <= 80
    assert text.count("-1.683") == len(ARMS) and text.count("overload") == len(ARMS)


@pytest.mark.parametrize("width", [20, 40, 80])
def test_no_character_is_lost_at_any_width(width: int) -> None:
    row = ("abcdefghijklmnopqrst", "-1.6831", "max_torque 1000 to 500")
    table = Table("joint", "position", "written")
    table.add_row(*row)
    text = printed(width, table, "joint", "written")
    wanted = Counter("".join(row).replace(" ", ""))
    assert "…" not in text and not wanted - Counter(text)
