"""The discovery range of a process: which programs can reach its nodes, and with them the arm. No ROS.

ROS 2 without settings (SUBNET) finds every program of its domain on the whole network: in a classroom every arm obeys
everybody. So the nodes stay on this machine unless the environment or ``--network`` says otherwise.

ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST alone is not enough for that. With rmw_fastrtps of Jazzy (Fast DDS 2.14) it ends
the listening to multicast, and nothing else: the unicast sockets stay bound to all interfaces, and a host that names
this one in its ROS_STATIC_PEERS is let in (measured between two network namespaces). ROS_LOCALHOST_ONLY=1 is the same
without static peers of one's own. The profile this_machine.xml binds the sockets to the loopback interface, and has
programs announce themselves every half second instead of every three, so they find each other sooner.
"""

from collections.abc import Mapping, MutableMapping
from pathlib import Path
from typing import Final

RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
LOCALHOST_ONLY: Final = "ROS_LOCALHOST_ONLY"
PROFILES: Final = "FASTRTPS_DEFAULT_PROFILES_FILE"
PROFILE: Final = Path(__file__).with_name("this_machine.xml")

_OWN_SETTINGS: Final = ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER", PROFILES)
"""Settings that say whom to reach and how: where one of them is set, the profile stays away."""
_FAST_DDS: Final = ("", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")
_WHOLE_NETWORK: Final = ("SUBNET", "SYSTEM_DEFAULT")


def stay_on_this_machine(environment: MutableMapping[str, str]) -> None:
    """Set what rclpy and Fast DDS read from ``environment``, unless it has a discovery range already."""
    if not environment.get(RANGE):
        environment[RANGE] = "LOCALHOST"
        if environment.get("RMW_IMPLEMENTATION", "") in _FAST_DDS and not any(map(environment.get, _OWN_SETTINGS)):
            environment[PROFILES] = str(PROFILE)


def open_to_network(environment: MutableMapping[str, str]) -> None:
    """Set the discovery range of ``--network``."""
    if environment.get(RANGE) not in _WHOLE_NETWORK:
        environment[RANGE] = "SUBNET"
    environment.pop(LOCALHOST_ONLY, None)
    if environment.get(PROFILES) == str(PROFILE):  # of a program of ours that has started this one
        del environment[PROFILES]


def who_can_command(environment: Mapping[str, str]) -> str:
    """In words: the programs that can reach nodes with these settings.

    An unknown range is LOCALHOST to rcl; ROS_LOCALHOST_ONLY=1 outweighs every range.
    """
    domain = f"ROS_DOMAIN_ID {environment.get('ROS_DOMAIN_ID', '0')}"
    local = environment.get(LOCALHOST_ONLY) == "1"
    if environment.get(RANGE) == "OFF" and not local:
        words = f"no other program can reach the arm: {RANGE} is OFF"
    elif environment.get(RANGE) in _WHOLE_NETWORK and not local:
        words = f"every program on the network with {domain} can command the arm"
    elif environment.get(PROFILES) == str(PROFILE):
        words = f"programs on this machine with {domain} can command the arm; --network lets the network in"
    else:
        words = f"programs on this machine with {domain} can command the arm, and hosts whose ROS_STATIC_PEERS name it"
        if settings := [name for name in _OWN_SETTINGS if environment.get(name)]:
            words += f"; others as {' and '.join(settings)} lets them"
    return words + _security(environment)


def _security(environment: Mapping[str, str]) -> str:
    """DDS security, as rcl reads it: only with Enforce is a program without keys kept out."""
    enabled, strategy = environment.get("ROS_SECURITY_ENABLE"), environment.get("ROS_SECURITY_STRATEGY")
    return ", with keys of ROS_SECURITY_KEYSTORE" if (enabled, strategy) == ("true", "Enforce") else ""
