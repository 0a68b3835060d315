"""``servoloop topic-host``: run an arm under the controller manager of ros2_control."""

from dataclasses import dataclass, replace
from typing import Annotated

import typer

from drivers.driver_errors import DriverError
from nodes.topic_host.topics import COMMANDS, NAME, OTHER, STATES, HostTopics
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.commands.shared.options import NetworkOption, set_network
from servoloop.commands.shared.other_stacks import search_for_others
from servoloop.commands.up import HardwareOption, PortOption, ReadyFileOption, announced, check_ready_file
from servoloop.recording.mcap import RecordOption, check_path
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.arm_options import NamespaceOption, ServoArm, xacro_arguments
from servoloop.stack.devices import parse_ports
from servoloop.stack.terminal import log_to_terminal


@dataclass(frozen=True, slots=True)
class TopicHostOptions:
    """Options for the loop and its topics."""

    rate: Annotated[
        int | None,
        typer.Option(
            min=1, max=1000, metavar="HZ", help="Rate of the control loop (default: the rate in the controllers file)."
        ),
    ] = None
    states_topic: Annotated[str, typer.Option(help="Topic of the joint states.")] = STATES
    commands_topic: Annotated[str, typer.Option(help="Topic of the joint commands.")] = COMMANDS
    record: RecordOption = None
    namespace: NamespaceOption = ""


@grouped_options
def topic_host(
    *,
    hardware: HardwareOption = None,
    port: PortOption = None,
    arm: ServoArm,
    options: TopicHostOptions,
    network: NetworkOption = False,
    ready_file: ReadyFileOption = None,
) -> None:
    """Run an arm under ros2_control's controller manager until Ctrl-C.

    The plugin joint_state_topic_hardware_interface/JointStateTopicSystem connects the controller manager to the arm.
    Example: `servoloop topic-host --arm so101 --port /dev/ttyACM0 --rate 100`
    """
    from servoloop.topic_host import ForeignControllers
    from servoloop.topic_host import topic_host as run

    log_to_terminal()
    set_network(network)
    check_ready_file(ready_file)
    if options.states_topic == options.commands_topic:
        raise DriverError(f"--states-topic and --commands-topic are both {options.states_topic}: choose two topics")
    if options.record is not None:
        check_path(options.record)
    arguments, namespace = xacro_arguments(arm.xacro_arg), options.namespace
    files = read_arm_files(find_arm(arm.arm), arm.urdf, None, arm.robot, arguments, namespace)
    if options.rate is not None:
        files = replace(files, controllers=replace(files.controllers, update_rate_hz=options.rate))
    devices = parse_ports(port or [], files.robot.file.lines())

    topics = HostTopics(options.states_topic, options.commands_topic)
    with search_for_others(NAME, OTHER, namespace) as search, announced(ready_file) as ready:
        status = run(hardware, devices, files, ready, ForeignControllers(topics, options.record, search))
    raise typer.Exit(status)
