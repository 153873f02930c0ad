// Live curves of a run: one panel for each unit, one time axis, one cursor. Each channel is drawn as the mean of short
// intervals, with a band between the lowest and the highest value, so that an oscillation is seen and never aliased.
// @ts-check

/**
 * @typedef {{ name: string, label: string, isTarget: boolean }} Channel
 * @typedef {{ unit: string, title: string, least: number, channels: Channel[] }} Panel
 * @typedef {{ unit: string, at_s: number[], low: (number | null)[], high: (number | null)[], mean: (number | null)[] }} Series
 * @typedef {{ zero: string | null, until_s: number, width_s: number, channels: Record<string, Series> }} Answer
 */

const RENEW_MS = 2000;
const POINTS = 600;
const COLOURS = ["--first", "--second", "--third"];
const DASHES = [[], [8, 4], [2, 3]];
const TICKS_S = [60, 120, 300, 600, 1200, 1800, 3600, 7200, 10800, 21600, 43200, 86400];

const place = document.getElementById("plots");
// @ts-ignore  uPlot is a global of its own file
const uPlot = window.uPlot;
if (place !== null && uPlot !== undefined) begin(place);

/** @param {HTMLElement} place */
function begin(place) {
  const run = place.dataset.run ?? "";
  const zone = place.dataset.zone ?? "UTC";
  let panels = panelsOf(place);
  /** @type {number | null} */
  let last = place.dataset.last ? Number(place.dataset.last) : 900;
  /** @type {Answer | null} */
  let held = null;
  /** @type {any[]} */
  let plots = [];
  let isBusy = false;

  const draw = () => {
    for (const plot of plots) plot.destroy();
    place.replaceChildren();
    const shown = visible(panels, place);
    plots = shown.map((panel) => {
      const box = document.createElement("figure");
      const title = document.createElement("figcaption");
      title.textContent = `${panel.title} / ${panel.unit}`;
      box.append(title);
      place.append(box);
      return new uPlot(options(panel, place, zone, shown.length), data(panel, held), box);
    });
  };
  const renew = async () => {
    if (isBusy || document.hidden || panels.length === 0) return;
    isBusy = true;
    try {
      const since = held === null ? undefined : held.until_s - 2 * held.width_s;
      const answer = await load(run, panels, last, since, held?.width_s);
      if (answer !== null) {
        const old = held;
        held = joined(held, answer, last);
        const rounded = last !== null ? 0 : (held.until_s / held.width_s) > 2 * POINTS;
        if (rounded) held = null;
        else if (old === null) draw();
        else plots.forEach((plot, number) => plot.setData(data(visible(panels, place)[number], held)));
      }
    } finally {
      isBusy = false;
    }
  };
  for (const button of document.querySelectorAll("[data-last]")) {
    if (!(button instanceof HTMLButtonElement)) continue;
    button.parentElement?.removeAttribute("hidden");
    button.addEventListener("click", () => {
      for (const other of document.querySelectorAll("button[data-last]")) other.setAttribute("aria-pressed", String(other === button));
      last = button.dataset.last ? Number(button.dataset.last) : null;
      held = null;
      void renew();
    });
  }
  // A channel appears in the list of panels when its first reading is recorded.
  const list = document.getElementById("panels");
  if (list !== null) {
    new MutationObserver(() => {
      panels = panelsOf(place);
      held = null;
      void renew();
    }).observe(list, { childList: true, characterData: true, subtree: true });
  }
  new ResizeObserver(() => held !== null && draw()).observe(place);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  void renew();
  setInterval(() => void renew(), RENEW_MS);
}

/** @param {HTMLElement} place @returns {Panel[]} */
function panelsOf(place) {
  /** @type {Panel[]} */
  const all = JSON.parse(document.getElementById("panels")?.textContent || "[]");
  return place.dataset.only ? all.filter((panel) => panel.unit === place.dataset.only) : all;
}

/**
 * Panels for which there is room; on a phone the first one.
 * @param {Panel[]} panels @param {HTMLElement} place
 */
function visible(panels, place) {
  return place.clientWidth < 480 ? panels.slice(0, 1) : panels;
}

/**
 * @param {string} run @param {Panel[]} panels @param {number | null} last @param {number | undefined} since
 * @param {number | undefined} width @returns {Promise<Answer | null>}
 */
async function load(run, panels, last, since, width) {
  const query = new URLSearchParams({ points: String(POINTS) });
  for (const channel of panels.flatMap((panel) => panel.channels)) query.append("channel", channel.name);
  if (since !== undefined) query.set("since", String(Math.max(0, since)));
  else if (last !== null) query.set("last", String(last));
  if (width !== undefined) query.set("width", String(width));
  try {
    const answer = await fetch(`/api/v1/runs/${run}/series?${query}`);
    return answer.ok ? await answer.json() : null;
  } catch {
    return null; // the mark of a lost connection is on the page
  }
}

/**
 * What was held before the first interval of the answer, and the answer; without what has left the window.
 * @param {Answer | null} held @param {Answer} answer @param {number | null} last @returns {Answer}
 */
function joined(held, answer, last) {
  const from = last === null ? -Infinity : answer.until_s - last;
  /** @type {Record<string, Series>} */
  const channels = {};
  for (const name of new Set([...Object.keys(held?.channels ?? {}), ...Object.keys(answer.channels)])) {
    const before = held?.channels[name];
    const after = answer.channels[name];
    const first = after?.at_s[0] ?? Infinity;
    const kept = before === undefined ? [] : before.at_s.map((_, n) => n).filter((n) => before.at_s[n] < first && before.at_s[n] >= from);
    const one = /** @param {"at_s" | "low" | "high" | "mean"} key */ (key) =>
      [...kept.map((n) => /** @type {Series} */ (before)[key][n]), ...(after?.[key] ?? [])];
    channels[name] = /** @type {Series} */ ({ unit: (after ?? before)?.unit ?? "", at_s: one("at_s"), low: one("low"), high: one("high"), mean: one("mean") });
  }
  return { ...answer, channels };
}

/**
 * Columns of a panel: instants, then mean, low and high of each channel. A gap is null, a channel without a value at
 * the instant of another one is undefined.
 * @param {Panel} panel @param {Answer | null} held
 */
function data(panel, held) {
  const series = panel.channels.map((channel) => held?.channels[channel.name]);
  const at = [...new Set(series.flatMap((each) => each?.at_s ?? []))].sort((a, b) => a - b);
  const zero = held?.zero ? Date.parse(held.zero) / 1000 : 0;
  const columns = series.flatMap((each) => {
    const found = new Map(each?.at_s.map((at_s, n) => [at_s, n]));
    const gap = Math.max(3 * (held?.width_s ?? 0), 60);
    let before = -Infinity;
    /** @type {(number | null | undefined)[][]} */
    const three = [[], [], []];
    for (const at_s of at) {
      const n = found.get(at_s);
      const value = n === undefined || each === undefined ? (at_s - before > gap ? null : undefined) : n;
      if (typeof value === "number") before = at_s;
      [each?.mean, each?.low, each?.high].forEach((column, m) => three[m].push(typeof value === "number" ? column?.[value] : value));
    }
    return three;
  });
  return [at.map((at_s) => zero + at_s), ...columns];
}

/** @param {Panel} panel @param {HTMLElement} place @param {string} zone @param {number} count */
function options(panel, place, zone, count) {
  const ink = colour("--ink", place);
  const line = colour("--line", place);
  const axis = { stroke: ink, grid: { stroke: line, width: 1 }, ticks: { stroke: line }, font: "13px system-ui, sans-serif" };
  const isWall = document.body.classList.contains("wall");
  const font = isWall ? { font: "36px system-ui, sans-serif", size: 130 } : { size: 76 };
  const room = Math.floor(place.clientHeight / count) - (isWall ? 90 : 60);
  const value = (/** @type {any} */ _, /** @type {number | null | undefined} */ number) => number == null ? "–" : text(number, panel.unit);
  return {
    width: place.clientWidth,
    height: Math.max(count > 1 ? 150 : 220, room),
    cursor: { sync: { key: "bench" }, drag: { x: false, y: false } },
    legend: { show: !isWall },
    tzDate: (/** @type {number} */ s) => uPlot.tzDate(new Date(s * 1000), zone),
    scales: { x: { time: true }, y: { range: (/** @type {any} */ _, /** @type {number} */ low, /** @type {number} */ high) => range(low, high, panel.least) } },
    axes: [{ ...axis, ...(isWall ? { font: font.font, size: 60, space: 260 } : { size: 34 }), incrs: TICKS_S, values: "{HH}:{mm}" }, { ...axis, ...font, space: isWall ? 90 : 28, values: (/** @type {any} */ _, /** @type {number[]} */ ticks) => ticks.map(short) }],
    series: [
      { label: place.dataset.time, value: (/** @type {any} */ _, /** @type {number | null} */ s) => s == null ? "–" : clock(s, zone) },
      ...panel.channels.flatMap((channel, n) => {
        const stroke = channel.isTarget ? ink : colour(COLOURS[n % COLOURS.length], place);
        const hidden = { show: true, stroke: "transparent", points: { show: false }, class: "envelope", value: () => "" };
        return [
          { label: channel.label, stroke, width: isWall ? 4 : 2, dash: channel.isTarget ? [2, 6] : DASHES[n % DASHES.length], points: { show: false }, value, spanGaps: false },
          { ...hidden, label: "" },
          { ...hidden, label: "" },
        ];
      }),
    ],
    bands: panel.channels.map((channel, n) => ({ series: [3 * n + 3, 3 * n + 2], fill: colour(`${channel.isTarget ? "--line" : COLOURS[n % COLOURS.length]}`, place, 0.25) })),
  };
}

/**
 * The range of an axis: never narrower than what matters in this unit.
 * @param {number | null} low @param {number | null} high @param {number} least @returns {[number, number]}
 */
function range(low, high, least) {
  const lowest = low ?? 0;
  const highest = high ?? 0;
  const half = Math.max(highest - lowest, least) / 2 * 1.1;
  const middle = (lowest + highest) / 2;
  return [middle - half, middle + half];
}

/** @param {number} value */
function short(value) {
  return (Math.abs(value) >= 1e5 ? value.toPrecision(6) : String(Number(value.toPrecision(7)))).replace("-", "−");
}

/** @param {number} value @param {string} unit */
function text(value, unit) {
  const digits = { "°C": 2, "pulse/s": 1, "°": 3, "°/s": 3, A: 4, V: 3 }[unit] ?? 3;
  return value.toFixed(digits).replace("-", "−");
}

/** @param {number} s @param {string} zone */
function clock(s, zone) {
  return new Intl.DateTimeFormat("en-GB", { timeStyle: "medium", timeZone: zone }).format(new Date(s * 1000));
}

/**
 * The colour of a name in the present theme, for a canvas.
 * @param {string} name @param {HTMLElement} place @param {number} [opacity]
 */
function colour(name, place, opacity = 1) {
  const probe = document.createElement("span");
  probe.className = `probe probe${name}`;
  place.append(probe);
  const found = getComputedStyle(probe).color;
  probe.remove();
  return opacity === 1 ? found : found.replace(/^rgb\((.*)\)$/, `rgba($1, ${opacity})`);
}
