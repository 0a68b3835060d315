"""Discovery settings for each option, and the sentence that tells the user which programs can reach the nodes."""

import pytest

from nodes.discovery import PROFILE, PROFILES, describe_access, open_to_network, stay_on_this_machine

LOCAL = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
SUBNET = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
BOUND = LOCAL | {PROFILES: str(PROFILE)}


@pytest.mark.parametrize(
    ("environment", "added"),
    [
        ({}, BOUND),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": ""}, BOUND),
        ({"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}, BOUND),
        ({"ROS_LOCALHOST_ONLY": "1"}, BOUND),
        ({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, LOCAL),
        ({"ROS_STATIC_PEERS": "10.0.0.7"}, LOCAL),
        ({"ROS_DISCOVERY_SERVER": "10.0.0.7:11811"}, LOCAL),
        ({PROFILES: "/home/arm/mine.xml"}, LOCAL),
        (LOCAL, {}),
        (SUBNET, {}),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, {}),
        (BOUND, {}),
    ],
)
def test_nodes_stay_on_this_machine_by_default(environment: dict[str, str], added: dict[str, str]) -> None:
    found = dict(environment)
    stay_on_this_machine(found)
    assert found == environment | added


@pytest.mark.parametrize(
    ("environment", "after"),
    [
        ({}, SUBNET),
        (LOCAL, SUBNET),
        (BOUND, SUBNET),
        (LOCAL | {PROFILES: "/home/arm/mine.xml"}, SUBNET | {PROFILES: "/home/arm/mine.xml"}),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, SUBNET),
        ({"ROS_LOCALHOST_ONLY": "1", "ROS_DOMAIN_ID": "3"}, SUBNET | {"ROS_DOMAIN_ID": "3"}),
        (SUBNET, SUBNET),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"}, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"}),
    ],
)
def test_network_option_opens_nodes_to_the_network(environment: dict[str, str], after: dict[str, str]) -> None:
    found = dict(environment)
    open_to_network(found)
    stay_on_this_machine(found)
    assert found == after


@pytest.mark.parametrize(
    ("environment", "words"),
    [
        (BOUND, "programs on this machine with ROS_DOMAIN_ID 0 can command the arm; --network opens it to the network"),
        (BOUND | {"ROS_DOMAIN_ID": "7"}, "programs on this machine with ROS_DOMAIN_ID 7 can"),
        (
            LOCAL,
            "programs with ROS_DOMAIN_ID 0 on this machine and on hosts that list this machine in ROS_STATIC_PEERS",
        ),
        (LOCAL | {"ROS_STATIC_PEERS": "a;b"}, "can command the arm, and so can programs that ROS_STATIC_PEERS admits"),
        (SUBNET | {"ROS_LOCALHOST_ONLY": "1"}, "programs with ROS_DOMAIN_ID 0 on this machine and on hosts"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "subnet"}, "programs with ROS_DOMAIN_ID 0 on this machine and on hosts"),
        (SUBNET, "every program on the network with ROS_DOMAIN_ID 0 can command the arm"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"}, "every program on the network"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, "no other program can reach the arm"),
        (
            SUBNET | {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"},
            "can command the arm; keys from ROS_SECURITY_KEYSTORE required",
        ),
    ],
)
def test_access_description_covers_all_programs_that_can_reach_the_arm(environment: dict[str, str], words: str) -> None:
    text = describe_access(environment)
    assert text.startswith(words) or text.endswith(words)


def test_permissive_security_excludes_no_program() -> None:
    permissive = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Permissive"}
    assert describe_access(SUBNET | permissive) == describe_access(SUBNET)
