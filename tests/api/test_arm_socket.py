"""``Arm.connect``: the contract of all arms over the command socket of ``servoloop up``, and its behavior when the
stack ends."""

import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from servoloop import Arm, ArmBusyError, ArmEndedError, ArmSetupError, StreamEndedError
from tests.api.contract import PAN, ArmContract, policy_waits_s
from tests.conftest import once_more
from tests.live.rig import runtime_folder
from tests.servoloop.up_process import running_up

pytestmark = [pytest.mark.slow, once_more]
SO101 = ("--no-ros", "--arm", "so101")


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with (
        pytest.MonkeyPatch.context() as patch,
        runtime_folder(patch),
        running_up(tmp_path_factory.mktemp("socket"), *SO101),
    ):
        yield


class TestConnectedArm(ArmContract):
    """The contract of ``Arm`` over the socket."""

    @pytest.fixture
    def arm(self, stack: None) -> Iterator[Arm]:
        with Arm.connect() as arm:
            yield arm


def test_two_programs_do_not_move_the_arm_at_once(stack: None) -> None:
    with Arm.connect("so101") as first, Arm.connect() as second:
        first.move_to({PAN: 0.0}, speed=0.5)
        with pytest.raises(ArmBusyError, match="has control of the arm"):
            second.move_to({PAN: 0.1})
        with first.stream(max_age=5.0) as stream:
            stream.send({PAN: 0.0})
            second.stop()
            with pytest.raises(StreamEndedError):
                stream.send({PAN: 0.1})
        second.move_to({PAN: 0.1}, speed=0.5)


def test_a_process_that_is_not_a_stack_is_refused(stack: None) -> None:
    with pytest.raises(ArmSetupError, match="no stack of 1 is running"):
        Arm.connect(1)


def test_a_closed_connection_explains_itself(stack: None) -> None:
    arm = Arm.connect()
    arm.close()
    arm.close()
    for call in (lambda: arm.state, lambda: arm.move_to({PAN: 0.0}), lambda: arm.torque(True), arm.stop, arm.step):
        with pytest.raises(ArmEndedError):
            call()


def test_the_end_of_the_stack_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with runtime_folder(monkeypatch):
        with pytest.raises(ArmSetupError, match="no stack is running"):
            Arm.connect()
        with running_up(tmp_path, *SO101) as process:
            arm = Arm.connect()
            motion = arm.move_to({PAN: 0.5}, duration=30.0, wait=False)
            process.send_signal(signal.SIGINT)
            with pytest.raises(ArmEndedError):
                arm.sleep(60.0)
        assert motion.done
        with pytest.raises(ArmEndedError):
            arm.move_to({PAN: 0.0})
        arm.close()


def test_a_policy_at_fifty_hertz_loses_no_target(stack: None) -> None:
    """No target is refused, and each target takes effect within one cycle of the loop."""
    with Arm.connect() as arm:
        waited_s = policy_waits_s(arm, 500)
        assert len(waited_s) > 100 and np.median(waited_s) < 1.2 / arm.rate_hz
