"""Texts of alerts in English and Chinese: one line of what happened, one of what to do, and the link to the page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

LANGUAGES = ("en", "zh")
LINE_LIMIT = 400  # characters of a line
TITLE_LIMIT = 150
_TEXTS: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "en": {
        "question": ("{bench}: the run asks: {text}", "Answer on the page of the run, or with: bench answer {run}"),
        "alarm": ("{bench}: {text}", "Look at the run; abort it if the bench is not as it should be."),
        "interlock": ("{bench}: {text} holds the run", "Look at the reading; the run goes on when it is right again."),
        "device_lost": ("{bench}: {device} is lost: {text}", "Check its power and its cable."),
        "end": ("{bench}: {title} has ended: {verdict}", "Read the report; the bench is free."),
        "safe_stop": (
            "{bench}: {title} was ended early ({state}, {verdict}): {text}",
            "Look at the bench before the next run; the page of the run has the reason.",
        ),
        "latched": (
            "{bench}: {title} did not end safely ({state}): {text}",
            "Go to the bench, make it safe by hand, then acknowledge the latch of the run.",
        ),
        "disk_low": (
            "{place}: only {free} GB free, less than {limit} GB",
            "Move old runs away: a run ends when the disk is full.",
        ),
        "item_refused": (
            "{bench}: item {number} ({title}) was refused: {text}",
            "Correct it and submit it again; the items behind it go on.",
        ),
        "item_held": ("{bench}: item {number} ({title}) is held: {text}", "Find the reason, then release the item."),
        "bench_stopped": (
            "{bench}: no further item begins: {text}",
            "Look at the bench; then an engineer lets it go on on the page of the bench.",
        ),
        "calibration_due": (
            "{bench}: calibrations are due: {text}",
            "Plan them now: runs are refused from the day after.",
        ),
        "digest": ("Since yesterday: {ran}", "Waiting: {waiting}. Due: {due}. Disk: {disk}. Open alerts: {open}."),
        "test": ("Test of the route {route}, sent by {by}", "Nothing is to be done: this route works."),
    },
    "zh": {
        "question": ("{bench}：运行正在提问：{text}", "请在运行页面上回答，或使用命令：bench answer {run}"),
        "alarm": ("{bench}：{text}", "请查看该运行；若试验台状态不正常，请中止运行。"),
        "interlock": ("{bench}：{text} 使运行暂停", "请查看该读数；恢复正常后运行自动继续。"),
        "device_lost": ("{bench}：设备 {device} 失去连接：{text}", "请检查其电源和电缆。"),
        "end": ("{bench}：{title} 已结束：{verdict}", "请阅读报告；试验台已空闲。"),
        "safe_stop": (
            "{bench}：{title} 提前结束（{state}，{verdict}）：{text}", "下次运行前请查看试验台；原因见运行页面。"
        ),
        "latched": (
            "{bench}：{title} 未安全结束（{state}）：{text}",
            "请到现场手动使试验台处于安全状态，然后确认该运行的锁定。",
        ),
        "disk_low": ("{place}：仅剩 {free} GB，低于 {limit} GB", "请移走旧的运行记录：磁盘写满时运行会终止。"),
        "item_refused": ("{bench}：任务 {number}（{title}）被拒绝：{text}", "请改正后重新提交；后面的任务继续进行。"),
        "item_held": ("{bench}：任务 {number}（{title}）被搁置：{text}", "请查明原因，然后放行该任务。"),
        "bench_stopped": ("{bench}：不再开始新任务：{text}", "请查看试验台；然后由工程师在试验台页面上允许继续。"),
        "calibration_due": ("{bench}：校准即将到期：{text}", "请立即安排校准：到期次日起运行将被拒绝。"),
        "digest": ("自昨天以来：{ran}", "等待：{waiting}。到期：{due}。磁盘：{disk}。未确认的报警：{open}。"),
        "test": ("报警通道 {route} 的测试，由 {by} 发送", "无需任何操作：该通道工作正常。"),
    },
}  # fmt: skip
_REMARKS: Mapping[str, Mapping[str, str]] = {
    "en": {
        "times": "{times} times", "historical": "while the station was down", "again": "may have been sent before",
        "escalated": "not acknowledged on route {route}", "none": "nothing",
    },
    "zh": {
        "times": "共 {times} 次", "historical": "发生在站点停机期间", "again": "可能已发送过",
        "escalated": "通道 {route} 上无人确认", "none": "无",
    },
}  # fmt: skip


class Message(NamedTuple):
    """Message of an alert."""

    title: str
    body: str


class Remarks(NamedTuple):
    """What is added to the line of what happened; `escalated` is the route on which nobody acknowledged it."""

    times: int = 1
    historical: bool = False
    again: bool = False
    escalated: str = ""


def message(station: str, text: str, values: Mapping[str, str], link: str, language: str, remarks: Remarks) -> Message:
    """Return the message of an alert in a language; its values may be hostile, and stay within their line."""
    fields = {key: one_line(value) or _REMARKS[language]["none"] for key, value in values.items()}
    what, do = (each.format_map(fields) for each in _TEXTS[language][text])
    if added := ", ".join(_remarks(remarks, language)):
        what = f"{_cut(what, LINE_LIMIT)} ({added})"
    title = _cut(f"{one_line(station)}: {what}", TITLE_LIMIT)
    return Message(title, "\n".join([_cut(what, LINE_LIMIT + TITLE_LIMIT), _cut(do, LINE_LIMIT), link]) + "\n")


def _remarks(remarks: Remarks, language: str) -> list[str]:
    words = _REMARKS[language]
    found = [words["times"].format(times=remarks.times)] if remarks.times > 1 else []
    found += [words[name] for name in ("historical", "again") if getattr(remarks, name)]
    return [*found, words["escalated"].format(route=remarks.escalated)] if remarks.escalated else found


def one_line(text: str) -> str:
    """Return a text in one line without control characters."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())


def _cut(text: str, letters: int) -> str:
    return text if len(text) <= letters else f"{text[: letters - 1]}…"
