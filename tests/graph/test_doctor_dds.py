"""The doctor's look at DDS, with real processes: as it should be, and with the wrong profile."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from roller_bringup.doctor import dds

pytestmark = pytest.mark.graph

CODE = (
    "from roller_bringup.doctor import dds; from dataclasses import asdict; import json; "
    "dds._TIMEOUT_S = 60.0; print(json.dumps(asdict(dds.exchange_messages())))"
)
BARE = """<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"/>
"""


def exchange(**environment: str) -> dds.Exchange:
    """In a process of its own: Fast DDS reads its profile once."""
    done = subprocess.run(
        [sys.executable, "-c", CODE], env=os.environ | environment, capture_output=True, text=True,
        timeout=90, check=True,
    )  # fmt: skip
    return dds.Exchange(**json.loads(done.stdout.splitlines()[-1]))


def test_messages_come_with_our_profile(domain):
    found = exchange()
    assert dds.judge_exchange(found).level != "fault"
    assert found.small == dds.MESSAGES
    assert found.large >= dds.MESSAGES // 2


def test_without_it_messages_are_lost(domain, tmp_path):
    (tmp_path / "bare.xml").write_text(BARE)
    for _ in range(3):  # now and then all of them come
        found = exchange(FASTDDS_DEFAULT_PROFILES_FILE=str(tmp_path / "bare.xml"))
        if found.large < dds.MESSAGES:
            break
    result = dds.judge_exchange(found)
    assert found.large < dds.MESSAGES
    assert result.level != "OK"


@pytest.mark.parametrize(
    ("environment", "faults"),
    [
        ({"ROS_DOMAIN_ID": "abc"}, {"DDS messages": "ROS_DOMAIN_ID"}),
        ({"ROS_DOMAIN_ID": "500"}, {"DDS messages": "domainId"}),
        ({"RMW_IMPLEMENTATION": "rmw_none"}, {"ROS 2": "rmw_none", "DDS messages": "rmw_none"}),
    ],
)
def test_what_ends_nodes_does_not_end_the_doctor(environment, faults):
    done = subprocess.run(
        [sys.executable, "-m", "roller_bringup.cli", "doctor", "--json"],
        env=os.environ | environment, capture_output=True, text=True, timeout=90,
    )  # fmt: skip
    results = json.loads(done.stdout)["checks"]
    found = {r["name"]: r["found"] for r in results if r["level"] == "fault"}
    assert done.returncode == 1
    assert {"clock", "disk"} <= {r["name"] for r in results}
    assert found.keys() >= faults.keys()
    for name, says in faults.items():
        assert says in found[name]


def test_exchange_by_what_came():
    everything = dds.Exchange(dds.MESSAGES, dds.MESSAGES, 2.0)
    assert dds.judge_exchange(everything).level == "OK"
    assert dds.judge_exchange(dds.Exchange(dds.MESSAGES, dds.MESSAGES - 1)).level == "warning"
    for lost in (dds.Exchange(dds.MESSAGES - 1, dds.MESSAGES), dds.Exchange(dds.MESSAGES, 3)):
        result = dds.judge_exchange(lost)
        assert (result.level, "images and poses will be lost" in result.advice) == ("fault", True)
    nothing = dds.judge_exchange(dds.Exchange())
    assert (nothing.level, "ROS_DOMAIN_ID" in nothing.advice) == ("fault", True)
    assert dds.judge_exchange(dds.Exchange(fault="no rclpy")).level == "fault"


def test_transport_by_its_facts(tmp_path):
    ours = str(Path(__file__).parents[2] / "config" / "fastdds.xml")
    (tmp_path / "bare.xml").write_text(BARE)
    for environment, level, says in (
        ({dds.PROFILE: ours, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, "OK", "LOCALHOST"),
        ({dds.PROFILE: f"file://{ours}", "ROS_LOCALHOST_ONLY": "1"}, "OK", "LOCALHOST"),
        ({dds.PROFILE: ours, "ROS_DOMAIN_ID": "7"}, "OK", "SUBNET (the default), domain 7"),
        ({}, "warning", "no Fast DDS profile is set"),
        ({dds.PROFILE: "/nowhere.xml"}, "fault", "can't be read"),
        ({dds.PROFILE: str(tmp_path / "bare.xml")}, "warning", "doesn't enlarge"),
    ):
        result = dds.judge_transport(dds.find_transport(environment, str(tmp_path)))
        assert result.level == level, environment
        assert says in result.found
    short = dds.judge_transport(dds.TransportFacts(ours, "segment_size", "LOCALHOST", "0", 64e6))
    assert (short.level, "--shm-size" in short.advice) == ("warning", True)
    full = dds.judge_transport(dds.TransportFacts(ours, "segment_size", "LOCALHOST", "0", 0.0))
    assert (full.level, "0 MB of shared memory" in full.found) == ("warning", True)
    none = dds.judge_transport(dds.find_transport({dds.PROFILE: ours}, str(tmp_path / "none")))
    assert (none.level, "can't be written" in none.found) == ("fault", True)
