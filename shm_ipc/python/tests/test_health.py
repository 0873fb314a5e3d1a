"""How a camera is."""

import json
import subprocess

import uvcam
from stage import Stage, next_frame, simulated, wait_until


def test_health_is_what_the_driver_tells(stage: Stage) -> None:
    stage.driver(simulated())
    wait_until("a rate", lambda: (uvcam.health("left", **stage.address) or {"frame_rate": 0})["frame_rate"] > 50)
    health = uvcam.health("left", **stage.address)
    assert health is not None
    told = json.loads(subprocess.run(stage.command("stats", "--json", "left"), capture_output=True, check=True).stdout)[0]
    assert (health["state"], health["cause"], health["last_error"]) == ("streaming", "none", "")
    for key in ("process_id", "config_digest", "mask_id", "epochs", "failures", "lost", "incomplete", "no_free_slot"):
        assert health[key] == told[key], key
    latency = health["arrival_to_masked"]
    assert 0 < latency["p50_ns"] <= latency["p99_ns"] <= latency["max_ns"]
    assert set(health) == uvcam.Health.__required_keys__
    assert set(latency) == uvcam.Latency.__required_keys__
    json.dumps(health)


def test_without_a_driver_there_is_none(stage: Stage) -> None:
    assert uvcam.health("left", **stage.address, timeout=0) is None
    stage.driver(simulated())
    with stage.subscriber() as subscriber:
        next_frame(subscriber)
    assert uvcam.health("right", **stage.address, timeout=0.01) is None
