"""What descriptions say of frames: it is there for every device that sends them, and fits its decoder."""

import pytest

from bench.config.bench import load_bench
from bench.store.decoder import Decoder
from drivers.can.decoded import Counts, FrameDecoder, Samples
from drivers.can.frame_block import FrameBlock
from drivers.can.sent_frames import Counted, Sampled
from drivers.description import known_drivers
from drivers.installed import loaded
from drivers.shipped import DRIVERS
from tests.support.laboratory import ROOT

SENDS = {"pulse_counter": (Counted, Counts), "telemetry": (Sampled, Samples)}
BENCHES = ("simulated", "telemetry", "imu", "imu_telemetry", "response", "table_telemetry", "indexing_telemetry")


@pytest.mark.parametrize("name", DRIVERS)
def test_a_driver_describes_frames_if_it_sends_outputs_by_itself(name):
    driver = known_drivers()[name]
    assert (driver.frames is not None) == bool(driver.capabilities & SENDS.keys())
    if driver.frames is not None:
        assert issubclass(loaded(driver.frames.decoder), FrameDecoder)
        assert driver.simulator


@pytest.mark.parametrize("name", BENCHES)
def test_channels_and_encoders_are_decoded_as_they_are_described(name):
    bench = load_bench(ROOT / f"config/{name}.yaml").bench
    senders = [entry for entry in bench.devices.values() if entry.description.frames is not None]
    assert senders
    for entry in senders:
        (capability,) = entry.description.capabilities & SENDS.keys()
        described, decoded = SENDS[capability]
        frames = loaded(entry.description.frames.decoder)(entry.options)
        found = frames.outputs(FrameBlock.empty())
        assert found.keys() == entry.outputs.keys() != set()
        assert all(isinstance(each, decoded) for each in found.values())
        assert all(isinstance(each, described) for each in entry.outputs.values())
        assert frames.positions(FrameBlock.empty()).keys() == entry.encoders.keys()
        assert {encoder.channel for encoder in entry.encoders.values()} <= {"", *entry.outputs}
        assert frames.watches()


def test_a_decoder_that_gives_what_is_not_described_is_named():
    entry = load_bench(ROOT / "config/simulated.yaml").bench.devices["counter"]
    decoder = Decoder(entry)
    decoder._outputs = dict.fromkeys(entry.outputs, Sampled(0.1, 1e-6))
    with pytest.raises(TypeError, match="channel 'x' is described as Sampled, decoded as Counts"):
        decoder.outputs(FrameBlock.empty())
