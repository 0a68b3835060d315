"""Errors 4 and 6 of virtual X servos: values outside the table, and goals beyond limit registers."""

import pytest

from drivers.servos import x
from drivers.servos.catalog import registers_of
from drivers.servos.register import Access, Register
from sim_backend.servos.dynamixel.servo import VirtualXServo
from tests.drivers.test_register_values import REFUSED

DATA_RANGE, DATA_LIMIT = 4, 6


def write(servo: VirtualXServo, register: Register, value: int) -> int:
    return servo.write(register.address, register.encode(value, "little"))


@pytest.mark.parametrize(
    ("model", "name", "value"),
    [row[:3] for row in REFUSED if isinstance(row[0], x.XModel) and row[1] != "goal_position"],
    ids=lambda v: getattr(v, "name", None),
)
def test_a_value_outside_the_table_is_error_4_and_changes_nothing(model: x.XModel, name: str, value: int) -> None:
    servo = VirtualXServo(model, 1)
    register = next(one for one in registers_of(model) if one.name == name)
    before = servo.memory.get(register)
    assert write(servo, register, value) == DATA_RANGE
    assert servo.memory.get(register) == before


@pytest.mark.parametrize("model", x.MODELS.values(), ids=lambda model: model.name)
def test_the_factory_values_of_every_model_are_in_its_table(model: x.XModel) -> None:
    memory = VirtualXServo(model, 1).memory
    for register in registers_of(model):
        if register.access is Access.READ_WRITE:
            assert register.takes(memory.get(register)), register.name


@pytest.mark.parametrize(
    ("goal", "limit", "value"),
    [
        (x.goal_velocity, x.velocity_limit, 100),
        (x.goal_current, x.current_limit, 500),
        (x.goal_pwm, x.pwm_limit, 400),
    ],
    ids=lambda v: getattr(v, "name", None),
)
def test_a_goal_beyond_its_limit_register_is_error_6(goal: Register, limit: Register, value: int) -> None:
    servo = VirtualXServo(x.XM430_W350, 1)
    assert write(servo, limit, value) == 0
    assert [write(servo, goal, sign * value) for sign in (1, -1)] == [0, 0]
    assert [write(servo, goal, sign * (value + 1)) for sign in (1, -1)] == [DATA_LIMIT] * 2


def test_the_goal_position_depends_on_the_mode() -> None:
    servo = VirtualXServo(x.XL430_W250, 1)
    assert write(servo, x.max_position_limit, 3000) == 0
    assert write(servo, x.goal_position, 3001) == DATA_LIMIT
    assert write(servo, x.operating_mode, x.EXTENDED_POSITION_MODE) == 0
    assert write(servo, x.goal_position, x.LARGEST_EXTENDED_POSITION) == 0
    assert write(servo, x.goal_position, x.LARGEST_EXTENDED_POSITION + 1) == DATA_RANGE
