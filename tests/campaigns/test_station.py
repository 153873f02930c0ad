"""A station is killed three times while its queue changes and runs go on."""

from campaigns.station import Round, faults_of_runs


def test_a_station_that_is_killed_loses_no_item_and_disturbs_no_run(tmp_path):
    played = Round(tmp_path / "round", seed=1, kills=3, items=6)
    assert played.play() == []
    assert played.killed == 3
    assert len(played.runs) >= 2
    assert played.answered.answers > 20


def test_an_item_without_its_run_and_a_run_without_an_item_are_found():
    ended = {"id": "i1", "number": 1, "state": "ended", "reason": ""}
    assert list(faults_of_runs([ended], [])) == ["item 1 is ended and has 0 runs"]
    assert list(faults_of_runs([ended | {"state": "refused", "reason": "why"}], [])) == ["item 1 is refused: why"]
    assert list(faults_of_runs([ended | {"state": "cancelled"}], [])) == []
