"""Tilt by two accelerometers with calibrations of earlier runs, worked out anew from what both really put out.

The first is in place a, the second in place b, 90° ahead of it. What is left is with the skew that their
axes really have.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from campaigns.truth.campaign import Comparison
from campaigns.truth.ramp import one_way
from campaigns.truth.verified import ENDS, EVERY_S, OFFSET_DEG, value

AHEAD_DEG = {"a": 0.0, "b": 90.0}
POSITIONS_DEG = (0.0, 90.0, 180.0, 270.0)
Forces = dict[str, np.ndarray]  # specific force by way of conversion


def compare_tumble(truth: dict, results: dict, known: dict) -> list[Comparison]:
    """Tilt in a tumble: at four positions of every dwell, from the constants of both units there."""
    dwells = {place: [dwell for key, dwell in truth["dwells"].items() if f"/{place}@" in key] for place in AHEAD_DEG}
    errors: dict[str, list[np.ndarray]] = {}
    for position_deg in POSITIONS_DEG:
        both = {place: _in_dwells(dwells[place], position_deg + OFFSET_DEG + ahead_deg, known[place]["channels"][0])
                for place, ahead_deg in AHEAD_DEG.items()}  # fmt: skip
        for way, error_deg in _errors_deg(truth, both, position_deg).items():
            errors.setdefault(way, []).append(error_deg)
    skews = [b["misalignment"] - a["misalignment"] for a, b in zip(dwells["a"], dwells["b"], strict=True)]
    return list(_compared(truth, results, {**_figures(errors), "tilt_of_two/skew": float(np.mean(skews))}))


def compare_ramp(truth: dict, results: dict, known: dict) -> list[Comparison]:
    """The same on the legs of a ramp at both positions."""
    errors: dict[str, list[np.ndarray]] = {}
    for position_deg in (0.0, 90.0):
        legs = {place: _legs(truth["legs"], place, position_deg) for place in AHEAD_DEG}
        means_c = {place: _mean_c(truth["legs"], place) for place in AHEAD_DEG}
        parts: dict[str, list[np.ndarray]] = {}
        for name, leg in legs["a"].items():
            rows = _rows(leg)
            both = {
                place: _on_leg(legs[place][name], rows, position_deg + AHEAD_DEG[place], known[place]["channels"][0],
                               means_c[place])
                for place in AHEAD_DEG
            }  # fmt: skip
            for way, error_deg in _errors_deg(truth, both, position_deg).items():
                parts.setdefault(way, []).append(error_deg)
        for way, each in parts.items():
            errors.setdefault(way, []).append(np.concatenate(each))
    return list(_compared(truth, results, _figures(errors)))


def _in_dwells(dwells: list[dict], position_deg: float, channel: dict) -> Forces:
    """Forces at one position from the constants at each dwell, at the temperature that it states."""
    at_c = np.array([dwell["temperature_c"] for dwell in dwells])
    k0, k1, k2, d = (np.array([dwell[name] for dwell in dwells]) for name in ("K0", "K1", "K2", "misalignment"))
    axis = np.radians(position_deg)
    output = k1 * (k0 + np.sin(axis) + d * np.cos(axis) + k2 * np.sin(axis) ** 2)
    return {
        "constant": _converted(output, np.full(len(at_c), np.mean(at_c)), channel),
        "static": _converted(output, at_c, channel),
    }


def _converted(output: np.ndarray, at_c: np.ndarray, channel: dict) -> np.ndarray:
    held_c = np.clip(at_c, *channel["valid_c"])
    return output / value(channel["scale"], held_c) - value(channel["bias"], held_c)


def _legs(legs: dict, place: str, position_deg: float) -> dict[str, dict[str, np.ndarray]]:
    """Whole legs of a unit at a position by their names."""
    return {
        key.partition("@")[2]: {name: np.array(values) for name, values in leg.items()}
        for key, leg in legs.items()
        if f"/{place}@" in key and f"position={position_deg:g}/" in key
    }


def _rows(leg: dict[str, np.ndarray]) -> np.ndarray:
    """Samples of a leg on its way with a known dT/dt."""
    numbered = one_way({**{name: values.tolist() for name, values in leg.items()}, "row": list(range(len(leg["K1"])))})
    return np.array(numbered["row"])[ENDS:-ENDS]


def _mean_c(legs: dict, place: str) -> float:
    """Mean temperature of a unit over the samples of its own legs at 0 g."""
    level_deg = -AHEAD_DEG[place] % 180
    temperatures = [leg["temperature_c"][_rows(leg)] for leg in _legs(legs, place, level_deg).values()]
    return float(np.mean(np.concatenate(temperatures)))


def _on_leg(leg: dict[str, np.ndarray], rows: np.ndarray, axis_deg: float, channel: dict, mean_c: float) -> Forces:
    """Forces of a unit at some samples of a leg, its axis at a nominal angle."""
    at_c = leg["temperature_c"]
    rate_c_per_min = np.full(len(at_c), np.nan)
    rate_c_per_min[ENDS:-ENDS] = (at_c[2 * ENDS :] - at_c[: -2 * ENDS]) / (2 * ENDS * EVERY_S / 60)
    output = (leg["output_g"] + np.sin(np.radians(axis_deg + OFFSET_DEG))) * leg["K1"]
    static = _converted(output, at_c, channel)
    dynamic = static
    if "dynamic" in channel:
        held_c = np.clip(at_c, *channel["valid_c"])
        model = value(channel["dynamic"]["bias"], held_c) + channel["dynamic"]["rate"]["value"] * rate_c_per_min
        dynamic = static + value(channel["bias"], held_c) - model
    constant = _converted(output, np.full(len(at_c), mean_c), channel)
    return {"constant": constant[rows], "static": static[rows], "dynamic": dynamic[rows]}


def _compared(truth: dict, results: dict, true: Mapping[str, float]) -> Iterator[Comparison]:
    for found in results["findings"]:
        if found["quantity"] in true:
            yield Comparison.of(truth["seed"], found, true[found["quantity"]])


def _errors_deg(truth: dict, both: Mapping[str, Forces], position_deg: float) -> dict[str, np.ndarray]:
    """Indicated tilt less the true one, with the true skew between both axes."""
    skew = truth["units"]["b"]["misalignment_o"] - truth["units"]["a"]["misalignment_o"]
    found = {}
    for way, along in both["a"].items():
        upward = (both["b"][way] + along * np.sin(skew)) / np.cos(skew)
        pointing = (upward + 1j * along) * np.exp(-1j * np.radians(position_deg + OFFSET_DEG))
        found[way] = np.degrees(np.angle(pointing))
    return found


def _figures(errors: Mapping[str, list[np.ndarray]]) -> dict[str, float]:
    """Figures from errors by position, the level one first."""
    spans = {way: max(float(np.ptp(each)) for each in at) for way, at in errors.items()}
    largest = {way: float(np.max(np.abs(np.concatenate(at) - np.mean(at[0])))) for way, at in errors.items()}
    return {
        "tilt_of_two/uncompensated": spans["constant"],
        "tilt_of_two/verified": spans["static"],
        "tilt_of_two/verified_dynamic": spans.get("dynamic", np.nan),
        "tilt_of_two/left_largest": largest["static"],
        "tilt_of_two/left_largest_dynamic": largest.get("dynamic", np.nan),
    }
