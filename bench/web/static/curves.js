// Live curves of a run: one panel for each unit, one time axis, one cursor. Each channel is drawn as the mean of short
// intervals, with a band between the lowest and the highest value, so that an oscillation is seen and never aliased.
// "Scope" draws each sample of the newest acquisition instead.
// @ts-check

/**
 * @typedef {{ name: string, label: string, isTarget: boolean, isSwung?: boolean }} Channel
 * @typedef {{ unit: string, title: string, least: number, zero?: boolean, channels: Channel[] }} Panel
 * @typedef {{ unit: string, at_s: number[], low: (number | null)[], high: (number | null)[], mean: (number | null)[] }} Series
 * @typedef {{ zero: string | null, until_s: number, width_s: number, channels: Record<string, Series> }} Answer
 */

const RENEW_MS = 2000;
const POINTS = 600;
const FIRST = 3; // panels that are seen without scrolling
const LEAST_PX = 64;
const SWING_S = 30; // around a polled reading of an axis that oscillates, in which its lowest and highest values are looked for
const COLOURS = ["--first", "--second", "--third"];
const DASHES = [[], [8, 4], [2, 3]];
const SCOPE_TICKS_S = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30];
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
  let isScope = false;
  /** @type {Answer | null} */
  let held = null;
  /** @type {any[]} */
  let plots = [];
  let isBusy = false;

  const shown = () => isScope ? scopePanels(held, panels, place) : visible(panels, place);
  const draw = () => {
    for (const plot of plots) plot.destroy();
    place.replaceChildren();
    const all = shown();
    if (all.length === 0) {
      const nothing = document.createElement("p");
      nothing.className = "quiet";
      nothing.textContent = (isScope ? place.dataset.noSamples : "") ?? "";
      place.append(nothing);
    }
    plots = all.map((panel, number) => {
      const box = document.createElement("figure");
      const title = document.createElement("figcaption");
      const name = document.createElement("span");
      name.textContent = `${panel.title} / ${panel.unit}`;
      title.append(name);
      box.append(title);
      place.append(box);
      const hasTimes = number === Math.min(FIRST, all.length) - 1 || number === all.length - 1;
      if (hasTimes) box.className = "times";
      const plot = new uPlot(options(panel, place, zone, hasTimes, isScope, () => span(held, last)), data(panel, held), box);
      const legend = box.querySelector(".u-legend");
      if (legend !== null) title.append(legend);
      return plot;
    });
    fit(plots, place);
  };
  const renew = async () => {
    if (isBusy || document.hidden || panels.length === 0) return;
    isBusy = true;
    try {
      const wasScope = isScope;
      const since = held === null ? undefined : held.until_s - 2 * held.width_s;
      const answer = isScope ? await loadSamples(run) : await load(run, panels, last, since, held?.width_s);
      if (answer === null || wasScope !== isScope) return;
      const old = held;
      const before = shown().length;
      held = isScope ? answer : joined(held, answer, last);
      const rounded = !isScope && last === null && held.until_s / held.width_s > 2 * POINTS;
      if (rounded) held = null;
      else if (old === null || shown().length !== before) draw();
      else plots.forEach((plot, number) => plot.setData(data(shown()[number], held)));
    } finally {
      isBusy = false;
    }
  };
  for (const button of document.querySelectorAll("[data-last], [data-scope]")) {
    if (!(button instanceof HTMLButtonElement)) continue;
    button.parentElement?.removeAttribute("hidden");
    button.addEventListener("click", () => {
      for (const other of document.querySelectorAll("button[data-last], button[data-scope]")) other.setAttribute("aria-pressed", String(other === button));
      isScope = button.dataset.scope !== undefined;
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
 * The time that all panels show, in s since 1970.
 * @param {Answer | null} held @param {number | null} last @returns {[number, number]}
 */
function span(held, last) {
  const zero = held?.zero ? Date.parse(held.zero) / 1000 : 0;
  const series = Object.values(held?.channels ?? {}).map((each) => each.at_s).filter((each) => each.length > 0);
  const first = Math.min(...series.map((each) => each[0]));
  const end = Math.max(...series.map((each) => each[each.length - 1]));
  if (series.length === 0) return [zero, zero + 1];
  const begin = last === null || held?.width_s === 0 ? first : Math.max(end - last, Math.min(first, end - last / 5));
  return [zero + begin, zero + Math.max(end, begin + 1e-3)];
}

/**
 * Heights by which the first panels fill the place; the others are reached by scrolling.
 * @param {any[]} plots @param {HTMLElement} place
 */
function fit(plots, place) {
  const count = Math.min(FIRST, plots.length);
  const captions = [...place.querySelectorAll("figcaption")].slice(0, count);
  const taken = captions.reduce((sum, each) => sum + each.getBoundingClientRect().height, 0);
  const times = plots.slice(0, count).reduce((sum, plot) => sum + plot.axes[0].size(), 0);
  const room = Math.floor((place.clientHeight - taken - times - 4) / count);
  const height = Math.max(document.body.classList.contains("wall") || count === 1 ? 160 : LEAST_PX, room);
  for (const plot of plots) plot.setSize({ width: place.clientWidth, height: height + plot.axes[0].size() });
}

/**
 * Panels of the newest samples, one for each unit, with the words of the usual ones.
 * @param {Answer | null} held @param {Panel[]} panels @param {HTMLElement} place @returns {Panel[]}
 */
function scopePanels(held, panels, place) {
  const known = new Map(panels.flatMap((panel) => panel.channels).map((channel) => [channel.name, channel.label]));
  /** @type {Map<string, Panel>} */
  const found = new Map();
  for (const [name, series] of Object.entries(held?.channels ?? {})) {
    const usual = panels.find((panel) => panel.unit === series.unit && !panel.zero);
    const panel = found.get(series.unit) ?? { unit: series.unit, title: usual?.title ?? place.dataset.output ?? "", least: 0, channels: [] };
    panel.channels.push({ name, label: known.get(name) ?? name, isTarget: false });
    found.set(series.unit, panel);
  }
  return [...found.values()];
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

/** @param {string} run @returns {Promise<Answer | null>} */
async function loadSamples(run) {
  try {
    const answer = await fetch(`/api/v1/runs/${run}/samples`);
    if (!answer.ok) return null;
    const found = await answer.json();
    const channels = Object.fromEntries(Object.entries(found.channels).map(([name, each]) => [name, { unit: each.unit, at_s: each.at_s, low: each.values, high: each.values, mean: each.values }]));
    return { zero: found.zero, until_s: found.until_s, width_s: 0, channels };
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
  const series = panel.channels.map((channel) => swung(held?.channels[channel.name], channel, held?.width_s ?? 0));
  const at = [...new Set(series.flatMap((each) => each?.at_s ?? []))].sort((a, b) => a - b);
  const zero = held?.zero ? Date.parse(held.zero) / 1000 : 0;
  const columns = series.flatMap((each) => {
    const found = new Map(each?.at_s.map((at_s, n) => [at_s, n]));
    const gap = held?.width_s === 0 ? Infinity : Math.max(3 * (held?.width_s ?? 0), 60);
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

/**
 * A polled reading of an axis that oscillates has too few values for a curve: only its envelope is drawn while it moves.
 * @param {Series | undefined} series @param {Channel} channel @param {number} width
 */
function swung(series, channel, width) {
  if (series === undefined || !channel.isSwung || width > SWING_S) return series;
  const low = [...series.low];
  const high = [...series.high];
  const mean = [...series.mean];
  let first = 0;
  series.at_s.forEach((at_s, n) => {
    while (series.at_s[first] < at_s - SWING_S) first += 1;
    for (let m = first; m < series.at_s.length && series.at_s[m] <= at_s + SWING_S; m += 1) {
      low[n] = Math.min(low[n] ?? Infinity, series.low[m] ?? Infinity);
      high[n] = Math.max(high[n] ?? -Infinity, series.high[m] ?? -Infinity);
    }
    if ((high[n] ?? 0) - (low[n] ?? 0) > 0.01) mean[n] = null;
  });
  return { ...series, low, high, mean };
}

/** @param {Panel} panel @param {HTMLElement} place @param {string} zone @param {boolean} hasTimes @param {boolean} isScope @param {() => [number, number]} shown */
function options(panel, place, zone, hasTimes, isScope, shown) {
  const ink = colour("--ink", place);
  const line = colour("--line", place);
  const axis = { stroke: ink, grid: { stroke: line, width: 1 }, ticks: { stroke: line }, font: "13px system-ui, sans-serif" };
  const isWall = document.body.classList.contains("wall");
  const font = isWall ? { font: "36px system-ui, sans-serif", size: 130 } : { size: 76 };
  const times = isWall ? { font: font.font, size: 60, space: 260 } : hasTimes ? { size: 28 } : { size: 6, values: (/** @type {any} */ _, /** @type {number[]} */ ticks) => ticks.map(() => "") };
  const value = (/** @type {any} */ _, /** @type {number | null | undefined} */ number) => number == null ? "–" : text(number, panel.unit);
  return {
    width: place.clientWidth,
    height: 160,
    cursor: { sync: { key: "bench" }, drag: { x: false, y: false } },
    legend: { show: !isWall },
    tzDate: (/** @type {number} */ s) => uPlot.tzDate(new Date(s * 1000), zone),
    scales: { x: { time: true, range: shown }, y: { range: (/** @type {any} */ _, /** @type {number} */ low, /** @type {number} */ high) => range(low, high, panel) } },
    axes: [{ ...axis, incrs: isScope ? SCOPE_TICKS_S : TICKS_S, values: (/** @type {any} */ _, /** @type {number[]} */ ticks) => ticks.map((s) => clock(s, zone, isScope)), ...times }, { ...axis, ...font, space: isWall ? 90 : 28, values: (/** @type {any} */ _, /** @type {number[]} */ ticks) => ticks.map(short) }],
    series: [
      { label: place.dataset.time, value: (/** @type {any} */ _, /** @type {number | null} */ s) => s == null ? "–" : clock(s, zone, isScope, true) },
      ...panel.channels.flatMap((channel, n) => {
        const stroke = channel.isTarget ? ink : colour(COLOURS[n % COLOURS.length], place);
        const hidden = { show: true, stroke: "transparent", points: { show: false }, class: "envelope", value: () => "" };
        return [
          { label: channel.label, stroke, width: isWall ? 4 : 2, dash: channel.isTarget ? [2, 6] : DASHES[(n + Math.floor(n / COLOURS.length)) % DASHES.length], points: { show: false }, value, spanGaps: false },
          { ...hidden, label: "" },
          { ...hidden, label: "" },
        ];
      }),
    ],
    bands: panel.channels.map((channel, n) => ({ series: [3 * n + 3, 3 * n + 2], fill: colour(`${channel.isTarget ? "--line" : COLOURS[n % COLOURS.length]}`, place, 0.25) })),
  };
}

/**
 * The range of an axis: never narrower than what matters in this unit; that of a deviation has zero in it.
 * @param {number | null} low @param {number | null} high @param {Panel} panel @returns {[number, number]}
 */
function range(low, high, panel) {
  const lowest = panel.zero ? Math.min(low ?? 0, 0) : low ?? 0;
  const highest = panel.zero ? Math.max(high ?? 0, 0) : high ?? 0;
  const half = Math.max(highest - lowest, panel.least || 1e-9) / 2 * 1.1;
  const middle = (lowest + highest) / 2;
  return [middle - half, middle + half];
}

/** @param {number} value */
function short(value) {
  return (Math.abs(value) >= 1e5 ? value.toPrecision(6) : String(Number(value.toPrecision(7)))).replace("-", "−");
}

/** @param {number} value @param {string} unit */
function text(value, unit) {
  const digits = { "°C": 2, "pulse/s": 1, code: 1, "°": 3, "°/s": 3, A: 4, V: 3 }[unit] ?? 3;
  return value.toFixed(digits).replace("-", "−");
}

/** @type {Map<string, Intl.DateTimeFormat>} */
const forms = new Map();

/** @param {number} s @param {string} zone @param {boolean} isScope @param {boolean} [isWhole] */
function clock(s, zone, isScope, isWhole = false) {
  const key = `${zone} ${isScope} ${isWhole}`;
  const form = forms.get(key) ?? new Intl.DateTimeFormat("en-GB", {
    timeZone: zone, ...(isWhole || !isScope ? { hour: "2-digit", minute: "2-digit" } : { minute: "2-digit" }),
    ...(isWhole || isScope ? { second: "2-digit" } : {}), ...(isScope ? { fractionalSecondDigits: 3 } : {}),
  });
  forms.set(key, form);
  return form.format(new Date(s * 1000));
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
