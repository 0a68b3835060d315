"""Programs on the command socket of a simulated stack, which perform the socket actions of a schedule."""

from servoloop.api.own_loop import describe
from servoloop.api.stack_backend import StackBackend
from servoloop.campaign.socket_clients.between_cycles import BetweenCycles
from servoloop.campaign.socket_clients.program import ServedPrograms, SocketProgram
from servoloop.command_server.requests import StackRequests
from servoloop.recording.stack_recording import StackRecording
from servoloop.simulation.acts import SocketAct
from servoloop.simulation.faulty_stack import FaultyStack


class ConnectedPrograms:
    """Programs that are connected to the command server of one stack, keyed by connection number."""

    def __init__(self, stack: FaultyStack) -> None:
        """Serve an active stack whose loop is not running yet."""
        time, control, recording = BetweenCycles(stack.loop), stack.control_stack, StackRecording(None)
        arm = StackBackend(control, describe(control), time, lambda: None, recording)
        self.served = ServedPrograms(stack, StackRequests(control, arm, recording, time))
        """Results of all programs."""
        self._programs: dict[int, SocketProgram] = {}

    @property
    def last_target_s(self) -> float:
        """Time of the latest stream target, in seconds, or minus infinity before the first stream."""
        return self.served.last_target_s

    @property
    def owner(self) -> str:
        """Name of the program that has control of the arm, or an empty string."""
        return self.served.requests.ownership.owner

    @property
    def dead_owner(self) -> str:
        """Name of a program that still has control of the arm although it has died, or an empty string."""
        open_names = {program.name for program in self._programs.values() if program.open}
        return "" if self.owner in open_names else self.owner

    def carry_out(self, act: SocketAct) -> None:
        """Make the program on the action's connection perform the action. Restart a dead program first."""
        program = self._programs.get(act.connection)
        if program is None or not program.open:
            self._programs[act.connection] = program = SocketProgram(act.connection, self.served)
        program.carry_out(act)

    def cycle(self) -> None:
        """Resume all programs after a cycle."""
        for program in self._programs.values():
            if program.open:
                program.cycle()

    def die(self) -> None:
        """End all connections."""
        for program in self._programs.values():
            if program.open:
                program.hang_up()

    def require_no_defect(self) -> None:
        """Raise RuntimeError if the stack has replied to a message with an internal error."""
        if self.served.defects:
            raise RuntimeError(
                f"the command server had an internal error while handling the messages {self.served.defects}"
            )
