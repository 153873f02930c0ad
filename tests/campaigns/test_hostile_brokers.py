"""A station that publishes to a hostile broker: a run is not slowed."""

from __future__ import annotations

import os
import socket
import threading
from contextlib import contextmanager
from statistics import median

import pytest

from bench.clock import Stopwatch
from bench.store.tail import Tail
from tests.support.broker import Port, station_file
from tests.support.served import on_real_wires, simulating
from tests.support.station import serving

pytestmark = pytest.mark.integration
WAITS = """\
schema: itb-sequence/1
title: Steps of a known duration
needs: {supply: power_supply}
steps:
  - repeat: 5
    steps:
      - wait: 2 s
"""
CONNACK = bytes([0x20, 3, 0, 0, 0])


def mute(peer, _):
    peer.sendall(CONNACK)


def dripping(peer, data):
    for byte in CONNACK * 100:
        peer.sendall(bytes([byte]))
        threading.Event().wait(1.0)


def malformed(peer, number):
    peer.sendall(CONNACK)
    for _ in range(500):
        peer.sendall(os.urandom(1 + number % 50))


def huge(peer, _):
    topic = b"bench/lab3/status"
    head = bytes([0x31, 0xFF, 0xFF, 0xFF, 0x7F, 0, len(topic)]) + topic + b"\0"
    peer.sendall(CONNACK + head)
    for _ in range(256):
        peer.sendall(bytes(1 << 20))


def flood(peer, _):
    peer.sendall(CONNACK)
    packet = bytes([0x30, 10, 0, 1, 97, 0, *b"123456"])
    while True:
        peer.sendall(packet * 1000)


@contextmanager
def hostile(behaviour):
    """A broker that answers the first bytes of each connection with a behaviour; its port, and the connections."""
    listener, connections = socket.create_server(("127.0.0.1", 0)), []

    def one(peer, number):
        with peer:
            try:
                peer.settimeout(20)
                peer.recv(4096)
                behaviour(peer, number)
                while peer.recv(65536):
                    pass
            except OSError:
                return

    def accept():
        while True:
            try:
                peer, _ = listener.accept()
            except OSError:
                return
            connections.append(peer)
            threads.append(threading.Thread(target=one, args=(peer, len(connections))))
            threads[-1].start()

    threads = [threading.Thread(target=accept)]
    threads[0].start()
    try:
        yield listener.getsockname()[1], connections
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        for peer in connections:
            try:
                peer.shutdown(socket.SHUT_RDWR)
            except OSError:
                continue
        for thread in threads:
            thread.join()


def step_s(folder, port):
    """Median duration in s of the steps of a run in real time, at a station that publishes to a port."""
    (folder / "own").mkdir()
    (folder / "own/waits.yaml").write_text(WAITS)
    bench = on_real_wires(folder)
    with simulating(bench), serving(folder, station_file(folder, Port(port), bench=str(bench))) as station:
        ended = station.ended(station.submit("waits", speed="1", units={"a": "QF-0001"}))
        assert ended["outcome"] == "completed", ended
        watch = Stopwatch()
        station.get("station")
        assert watch.elapsed_s() < 2.0
    begins, durations = {}, []
    with Tail(folder / "runs" / ended["run"]) as tail:
        events = tail.events()
    for event in events:
        if event.kind == "step_begins" and "wait" in event.step:
            begins[event.step] = event.at_s
        elif event.kind == "step_ended" and event.step in begins:
            durations.append(event.at_s - begins[event.step])
    assert len(durations) == 5
    return median(durations)


@pytest.mark.parametrize("behaviour", [mute, dripping, malformed, huge, flood])
def test_a_hostile_broker_does_not_slow_a_run(tmp_path, behaviour):
    with hostile(behaviour) as (port, connections):
        found_s = step_s(tmp_path, port)
    assert connections
    assert found_s == pytest.approx(2.0, rel=0.01)
