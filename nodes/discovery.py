"""Set the discovery range of a process, which determines which programs can reach its nodes. This module does not
import any ROS package.

By default (SUBNET), ROS 2 connects all programs in the same domain across the whole network. In a classroom, any
program could command any arm. The nodes are therefore limited to this machine unless the environment or ``--network``
opens them.

ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST alone does not achieve this. With rmw_fastrtps in Jazzy (Fast DDS 2.14), this
setting only disables multicast reception. The unicast sockets remain bound to all interfaces, and a host that lists
this machine in its ROS_STATIC_PEERS can connect (as measured between two network namespaces). ROS_LOCALHOST_ONLY=1 has
the same effect, but ignores the static peers of the process. The profile this_machine.xml binds the sockets to the
loopback interface. The profile also shortens the announcement period from 3 s to 0.5 s, so that programs discover each
other sooner.
"""

from collections.abc import Mapping, MutableMapping
from pathlib import Path
from typing import Final

RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
LOCALHOST_ONLY: Final = "ROS_LOCALHOST_ONLY"
PROFILES: Final = "FASTRTPS_DEFAULT_PROFILES_FILE"
PROFILE: Final = Path(__file__).with_name("this_machine.xml")

_OWN_SETTINGS: Final = ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER", PROFILES)
"""Settings with which a user chooses peers or a transport. If one of these variables is set, the profile is not
used."""
_FAST_DDS: Final = ("", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")
_WHOLE_NETWORK: Final = ("SUBNET", "SYSTEM_DEFAULT")


def stay_on_this_machine(environment: MutableMapping[str, str]) -> None:
    """Limit ROS 2 to this machine, unless ``environment`` already specifies a discovery range."""
    if not environment.get(RANGE):
        environment[RANGE] = "LOCALHOST"
        if environment.get("RMW_IMPLEMENTATION", "") in _FAST_DDS and not any(map(environment.get, _OWN_SETTINGS)):
            environment[PROFILES] = str(PROFILE)


def open_to_network(environment: MutableMapping[str, str]) -> None:
    """Open ROS 2 to the network, as requested with ``--network``."""
    if environment.get(RANGE) not in _WHOLE_NETWORK:
        environment[RANGE] = "SUBNET"
    environment.pop(LOCALHOST_ONLY, None)
    if environment.get(PROFILES) == str(PROFILE):  # A parent process of this project has already set the variable.
        del environment[PROFILES]


def describe_access(environment: Mapping[str, str]) -> str:
    """Describe which programs can reach nodes with these settings.

    rcl treats an unknown range as LOCALHOST. ROS_LOCALHOST_ONLY=1 takes precedence over any range.
    """
    domain = f"ROS_DOMAIN_ID {environment.get('ROS_DOMAIN_ID', '0')}"
    local = environment.get(LOCALHOST_ONLY) == "1"
    if environment.get(RANGE) == "OFF" and not local:
        text = f"no other program can reach the arm: {RANGE} is OFF"
    elif environment.get(RANGE) in _WHOLE_NETWORK and not local:
        text = f"every program on the network with {domain} can command the arm"
    elif environment.get(PROFILES) == str(PROFILE):
        text = f"programs on this machine with {domain} can command the arm; --network opens it to the network"
    else:
        hosts = "on this machine and on hosts that list this machine in ROS_STATIC_PEERS"
        text = f"programs with {domain} {hosts} can command the arm"
        if settings := [name for name in _OWN_SETTINGS if environment.get(name)]:
            text += f", and so can programs that {' and '.join(settings)} admits"
    return text + _security(environment)


def _security(environment: Mapping[str, str]) -> str:
    """Return a note if DDS security is on. rcl excludes programs without keys only if the strategy is Enforce."""
    enabled, strategy = environment.get("ROS_SECURITY_ENABLE"), environment.get("ROS_SECURITY_STRATEGY")
    return "; keys from ROS_SECURITY_KEYSTORE required" if (enabled, strategy) == ("true", "Enforce") else ""
