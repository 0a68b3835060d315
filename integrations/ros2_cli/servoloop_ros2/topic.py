"""``ros2 topic``: list, show and publish topics."""

import time
from math import inf
from typing import Annotated, Any, Final

import typer
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from servoloop_ros2.ros2_error import Ros2Error
from servoloop_ros2.session import SERVER_S, RosSession, print_names, session
from servoloop_ros2.values import as_yaml, fill, find_type, read_values

app = typer.Typer(no_args_is_help=True, help="List, show and publish topics.")
DEPTH: Final = 10
STATISTICS_S: Final = 1.0
"""Interval at which ``ros2 topic hz`` prints, in seconds."""
LINGER_S: Final = 0.1
"""Time for the delivery of the last message before the command exits, in seconds."""
Topic = Annotated[str, typer.Argument(help="Name of the topic.")]
Once = Annotated[bool, typer.Option("--once", "-1", help="Stop after one message.")]


@app.command("list")
def list_topics(
    show_types: Annotated[bool, typer.Option("--show-types", "-t", help="Also print types.")] = False,
) -> None:
    """List the topics."""
    with session() as found:
        print_names(found.names(found.node.get_topic_names_and_types), show_types)


@app.command()
def echo(
    topic: Topic,
    kind: Annotated[str | None, typer.Argument(metavar="TYPE", help="Type of the messages.")] = None,
    once: Once = False,
) -> None:
    """Print the messages of a topic."""
    with session() as found:
        messages = _subscribed(found, topic, kind)
        while True:
            if not found.spin_until(lambda: bool(messages), SERVER_S if once else inf):
                raise Ros2Error(f"no message on {topic} within {SERVER_S:g} s: check whether its program publishes")
            print(f"{as_yaml(messages.pop(0))}---", flush=True)
            if once:
                return


@app.command()
def hz(topic: Topic) -> None:
    """Print the rate of a topic once per second."""
    with session() as found:
        messages = _subscribed(found, topic, None)
        while True:
            began_s = time.monotonic()
            found.spin(STATISTICS_S)
            rate_hz = len(messages) / (time.monotonic() - began_s)
            print(f"average rate: {rate_hz:.3f}" if messages else "no new messages", flush=True)
            messages.clear()


@app.command()
def pub(
    topic: Topic,
    kind: Annotated[str, typer.Argument(metavar="TYPE", help="Type of the messages.")],
    values: Annotated[str, typer.Argument(help="Fields of the message as YAML.")] = "{}",
    once: Once = False,
    times: Annotated[int, typer.Option("--times", "-t", min=0, help="Number of messages; 0 for no limit.")] = 0,
    rate: Annotated[float, typer.Option("--rate", "-r", min=0.001, help="Rate, in Hz.")] = 1.0,
) -> None:
    """Publish messages on a topic. With ``--once`` and ``--times``, the command waits for a subscriber."""
    cls, fields = find_type(kind, "msg"), read_values(values)
    count = 1 if once else times
    with session() as found:
        publisher = found.node.create_publisher(cls, topic, DEPTH)
        if count and not found.spin_until(lambda: publisher.get_subscription_count() > 0, SERVER_S):
            raise Ros2Error(
                f"no program subscribes to {topic}: start the program, or check the name with ros2 topic list"
            )
        print("publisher: beginning loop")
        number = 0
        while not count or number < count:
            number += 1
            message = cls()
            fill(message, fields, found.node.get_clock().now().to_msg())
            print(f"publishing #{number}: {message!r}\n", flush=True)
            publisher.publish(message)
            found.spin(LINGER_S if number == count else 1.0 / rate)


def _subscribed(found: RosSession, topic: str, kind: str | None) -> list[Any]:
    """Subscribe to a topic, and return the list that receives its messages."""
    if not found.spin_until(
        lambda: kind is not None or topic in dict(found.node.get_topic_names_and_types()), SERVER_S
    ):
        raise Ros2Error(f"no program publishes {topic}: start the program, or check the name with ros2 topic list")
    cls = find_type(kind or dict(found.node.get_topic_names_and_types())[topic][0], "msg")
    messages: list[Any] = []
    found.node.create_subscription(cls, topic, messages.append, _profile(found, topic))
    return messages


def _profile(found: RosSession, topic: str) -> QoSProfile:
    """Return the strictest profile that all publishers of a topic offer."""
    profiles = [publisher.qos_profile for publisher in found.node.get_publishers_info_by_topic(topic)]
    reliable = all(one.reliability == ReliabilityPolicy.RELIABLE for one in profiles)
    local = bool(profiles) and all(one.durability == DurabilityPolicy.TRANSIENT_LOCAL for one in profiles)
    return QoSProfile(
        depth=DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if local else DurabilityPolicy.VOLATILE,
    )
