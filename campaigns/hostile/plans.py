"""Sequences that are YAML and still hostile: odd steps, expressions, ranges without end, loops in loops."""

from __future__ import annotations

import json
import random
from typing import Any

from bench.sequence.steps.verbs import BLOCKS
from campaigns.hostile import corpus
from drivers.schema.fields import keys_of

NEEDS = {
    "chamber": "thermal_chamber", "head": "positioner", "counter": "pulse_counter", "supply": "power_supply",
    "source": "current_source", "unit_temperature": "thermometer",
}  # fmt: skip
_HOLD_STEPS = ("steps", "setup", "teardown", "then", "else", "during")
_SAFE_END = [{"set": "supply", "output": "off"}, {"set": "source", "output": "off"}, {"move": "head", "to": "0°"}]


def sequence(steps: list[Any], parameters: dict[str, Any] | None = None, **more: Any) -> str:
    """A whole sequence around steps, as JSON."""
    outline = {"schema": "itb-sequence/1", "title": "Hostile", "needs": NEEDS, "parameters": parameters or {}, **more}
    return json.dumps({**outline, "steps": steps, "teardown": _SAFE_END}, ensure_ascii=False)


# Files that lie beside a hostile one, for it to call.
NEIGHBOURS = {
    "called.yaml": sequence([{"wait": "${x}"}], {"x": {"help": "x", "default": "1 s"}}),
    **{
        f"chain_{link}.yaml": sequence([{"repeat": 10, "steps": [{"call": f"chain_{link + 1}.yaml"}]}])
        for link in range(9)
    },
    "chain_9.yaml": sequence([{"wait": "1 s"}]),
}


def steps(rng: random.Random) -> str:
    """Steps of every kind, with the right keys and mostly the right values."""
    return sequence([_step(rng, 0) for _ in range(rng.choice((1, 3, 10, 40)))], {"x": {"help": "x", "default": 5}})


def _step(rng: random.Random, level: int) -> Any:
    verb, model = rng.choice(list(BLOCKS.items()))
    keys = keys_of(model)
    if level > 6 and any(key in _HOLD_STEPS for key in keys):
        return {"note": "deep enough"}
    chosen = [verb, *(key for key in keys if key != verb and rng.random() < 0.85)]
    return {key: _of_a_step(rng, verb, key, level) for key in chosen}


def _of_a_step(rng: random.Random, verb: str, key: str, level: int) -> Any:
    if key == "parallel":
        return {name: [_step(rng, level + 1)] for name in "ab"}
    if key in _HOLD_STEPS and rng.random() < 0.95:
        return [_step(rng, level + 1) for _ in range(rng.choice((0, 1, 1, 2, 5)))]
    if rng.random() < 0.1:
        return "${" + expression(rng) + "}"
    return corpus.value(rng, f"{verb}.{key}")


def calls(rng: random.Random) -> str:
    """Sequences that call others, themselves, what is not there, or a chain of calls each ten times as long."""
    name = rng.choice((*NEIGHBOURS, "hostile.yaml", "simulated.yaml", "nothing.yaml", "../called.yaml", "/dev/zero"))
    given = rng.choice(({}, {"x": corpus.scalar(rng)}, {"x": "${x}"}, {"nothing": 1}, [], None))
    inside: list[Any] = [{"call": name, "with": given}]
    for _ in range(rng.choice((0, 0, 1, 3))):
        inside = [{"repeat": rng.choice((2, 10, 1000)), "steps": inside * rng.choice((1, 2))}]
    return sequence(inside, {"x": {"help": "x", "default": rng.choice([5, "20 °C"])}})


def expressions(rng: random.Random) -> str:
    """Hostile expressions wherever a value may stand."""
    texts = ["${" + expression(rng) + "}" for _ in range(rng.choice((1, 3, 20)))]
    step = rng.choice([
        lambda text: {"move": "head", "to": text}, lambda text: {"wait": text}, lambda text: {"note": text},
        lambda text: {"for_each": "y", "in": text, "steps": [{"wait": "1 s"}]},
        lambda text: {"repeat": text, "steps": [{"wait": "1 s"}]},
        lambda text: {"for_each": "y", "in": {"from": 0, "to": text}, "steps": [{"wait": "1 s"}]},
        lambda text: {"if": text, "then": [{"wait": "1 s"}]},
    ])  # fmt: skip
    parameters = {"x": {"help": "x", "default": rng.choice([5, "20 °C", [1, 2], "text", True, 1e308])}}
    return sequence([step(text) for text in texts], parameters)


def expression(rng: random.Random) -> str:
    """Content of the braces."""
    depth = rng.choice((3, 50, 90, 240, 2000))
    return rng.choice((
        "(" * depth + "1" + ")" * depth, "-" * depth + "1", "not " * depth + "x", "+".join(["x"] * depth),
        "max(" * depth + "1" + ")" * depth, "1 if " * depth + "x", "x if x else " * depth + "1",
        " < ".join(["1"] * depth), " and ".join(["x"] * depth), "9**9**9**9", "9" * depth, f"1e{depth}",
        "'" + "a" * depth + "'", "x" * depth, "'a' * 999999999", "1e308 * 1e308", "1 / 0", "x / (x - x)", "sqrt(-1)",
        "sqrt(1e308 * x)", "round(1e308)", "round(x)", "max()", "min('a', 1)", "max(x, key=len)", "abs(*x)",
        "len(x, x)", "sin('1 m')", "f'{x}'", "x.__class__", "x[0]", "().__class__.__bases__[0]",
        "__import__('os').system('reboot')", "open('/dev/zero').read()", "lambda: x", "[y for y in x]", "{1: 2}",
        "{x}", "(y := 5)", "await x", "yield x", "*x", "...", "None", "True", "1j", "b'x'", "0x10", "1_000", "0777",
        "1if 1else 2", "ｘ", "µ", "Ⅷ", "x\u0301", "𝓍", "x\ny", "x; y", "x # y", "'a' 'b'", "\"", "'", "x == x == x",
        "x is x", "x in x", "x @ x", "x // 2", "x % 2", "~x", "x << 99999999", "", " ", "\t x", "x" + " " * depth,
        "'9e99999 °C' * 0", "'1e-999999999 s'", "'1 " + "m·" * depth + "m'", "'" + "9" * depth + " °C'",
        "'5 °C' + '5 s'", "exec('1')", "e" * depth + "()",
        "".join(rng.choices("()x+-*/ 1.'<=,ifelsenotand", k=min(depth, 60))),
    ))  # fmt: skip


def ranges(rng: random.Random) -> str:
    """Ranges and lists with enormous counts, and with ends that do not go together."""

    def part() -> Any:
        return rng.choice(
            [corpus.number(rng), rng.choice(corpus.SCALARS), 0, 1e-300, 1e300, -5, rng.randint(0, 10**6), "${x}"]
        )

    if rng.random() < 0.3:
        values: Any = [{"from": 0, "to": 9_999}] * rng.choice((1, 2, 50))
    elif rng.random() < 0.2:
        values = [rng.randint(0, 9) for _ in range(rng.choice((10, 1000, 6000)))]
    else:
        keys = rng.choice((("from", "to", "step"), ("from", "to"), ("from", "step"), ("from", "to", "step", "until")))
        values = {key: part() for key in keys}
    loop = {"for_each": "y", "in": values, "steps": [{"wait": "${y}"}]}
    if rng.random() < 0.4:
        return sequence([{**loop, "in": "${x}"}], {"x": {"help": "x", "default": values}})
    return sequence([loop], {"x": {"help": "x", "default": 5}})


def explosions(rng: random.Random) -> str:
    """Few lines that mean very many steps, or steps with very much in them."""
    count = rng.choice((2, 10, 46, 100, 317, 1000, 9_999, 10**6, 10**18))
    inside: list[Any] = rng.choice([
        [{"wait": "1 s"}], [{"note": "x"}] * 30, [{"move": "head", "to": "${a}"}],
        [{"move": "head", "to": "${a + '1°'}"}, {"acquire": "counter", "for": "1 s", "label": "x"}],
        [{"note": "wide"}], [{"move": "head", "to": "400°"}],
        [{"set": "supply", "voltage": "15 V", "current_limit": "1 mA", "output": "on"}],
    ])  # fmt: skip
    values: Any = {"from": "0°", "to": f"{min(count, 9_999)}°", "step": "1°"}
    if rng.random() < 0.15:
        values = [letter * rng.choice((1, 50, 4000)) for letter in "abcdefghijklmnopqrstuvwxyz"]
    for name in "abcdefgh"[: rng.choice((1, 1, 2, 2, 3, 5, 8))]:
        inside = [rng.choice([
            {"for_each": name, "in": values, "steps": inside}, {"repeat": count, "steps": inside},
            {"group": name * 32, "steps": inside * rng.choice((1, 1, 3))},
        ])]  # fmt: skip
    results = [{"method": "temperature_tumble", "data": "x"}] if rng.random() < 0.3 else []
    parameters: dict[str, Any] = {"wide": {"help": "x", "default": [{"from": 1, "to": rng.choice((2, 9_999))}]}}
    if '"for_each": "a"' not in json.dumps(inside):
        parameters["a"] = {"help": "x", "default": "1°"}
    return sequence(inside, parameters, results=results)


def mistakes(rng: random.Random) -> str:
    """As many mistakes as there is room for: each wants its words, its place and a name that was meant."""
    count = rng.choice((10, 100, 600, 2000))
    kind = rng.choice((
        lambda index: {"mvoe": "head", "to": f"{index}°"}, lambda index: {"move": "haed", "too": index},
        lambda index: {"wait": f"{index} K"}, lambda index: {"wait": "${nothing" + str(index) + "}"},
        lambda index: {"group": f"g{index}", "steps": []}, lambda index: {"move": "head", "to": "400°"},
        lambda index: {f"k{index}": index}, lambda index: index, lambda index: {"note": ""},
    ))  # fmt: skip
    wrong: list[Any] = [kind(index) for index in range(count)]
    for level in range(rng.choice((0, 0, 1, 8))):
        wrong = [{"group": f"g{level}", "steps": wrong}]
    if rng.random() < 0.3:
        names = {f"p{index}": rng.choice([5, {"help": "x"}, {"help": "x", "defualt": 5}]) for index in range(count)}
        return sequence(wrong[:5], names)
    return sequence(wrong)
