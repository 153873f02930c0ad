"""The units on the channels of simulated devices that send frames."""

import pytest

from bench.app.can_nodes import node_setup
from bench.app.drawn import world_settings
from bench.app.laboratory import unit_files
from bench.config.bench import load_bench
from bench.errors import InputError
from simulators.faults.instrument_faults import FaultPlan
from simulators.world import World
from tests.support.laboratory import ROOT
from tests.support.runs import copy_bench


def setup_of(path, role, **changes):
    bench = load_bench(path).bench
    units = {name: unit.model_copy(update=changes) for name, unit in unit_files(bench, None).items()}
    return node_setup(bench, role, World(world_settings(bench, units, 1), lambda: 0.0), FaultPlan(), units, 0.0)


@pytest.mark.parametrize(
    ("name", "role", "channels"),
    [("simulated", "counter", {"x"}), ("telemetry", "telemetry", {"x"}),
     ("imu", "counter", {"ax", "ay", "az", "gx", "gy", "gz"})],
)  # fmt: skip
def test_each_channel_has_the_unit_of_its_place_or_a_sensor_of_it(name, role, channels):
    setup = setup_of(ROOT / f"config/{name}.yaml", role)
    assert setup.places.keys() == setup.units.keys()
    assert setup.units.keys() == channels
    assert len(set(map(id, setup.units.values()))) == len(channels)


def test_a_unit_that_sends_nothing_is_named_with_its_place():
    with pytest.raises(InputError, match="the simulated unit of place 'a' sends no codes: its file needs 'telemetry'"):
        setup_of(ROOT / "config/telemetry.yaml", "telemetry", telemetry=None)


def test_samples_that_are_no_means_are_not_simulated(tmp_path):
    path = copy_bench(tmp_path).with_name("telemetry.yaml")
    text = path.read_text("utf-8")
    assert text.count("period: 20 ms") == 1
    path.write_text(text.replace("period: 20 ms", "period: 20 ms\n          sample: instant"), "utf-8")
    with pytest.raises(InputError, match="sends means; write sample: mean"):
        setup_of(path, "telemetry")
