// Plots of any numbers: lanes by unit, the newest seconds at full rate; paused, they can be zoomed and saved.
import { data, isPast, keeps, note, onTick } from "./live.js";
import { marksIn, pastView } from "./timeline.js";
import { MARKS } from "./trace.js";

const page = document.querySelector(".plots");
const topics = await (await fetch(page.dataset.topics)).json();
const main = document.querySelector("main");
const canvas = document.getElementById("plot");
const legend = document.getElementById("plot-legend");
const pick = (name) => document.getElementById(`plot-${name}`);
const COLOURS = ["#4f9cf0", "#e8833a", "#3fbf8f", "#d65db1", "#b98cf0", "#c9b23a", "#5cc6d0", "#e5484d"];
const KEY = document.title; // with the name of the system
const KEPT_S = 60;
let signals = []; // { name, unit, t, v, seen, isCut, past }
let isPaused = false;
let wasPast = false;
let end = 0;
let zoom = null; // [from, to] while paused
let cursor = null;
let drag = null;

const option = (text, value) => Object.assign(document.createElement("option"), { textContent: text, value });
const field = () => topics[pick("topic").value]?.find((row) => row[0] === pick("field").value);
function fillFields() {
  pick("field").replaceChildren(...(topics[pick("topic").value] || []).map((row) => Object.assign(option(`${row[0]}${row[1] ? ` (${row[1].replace("|", " or ")})` : ""}`, row[0]), { title: row[3] })));
  fillIndexes();
}
function fillIndexes() {
  const indices = field()?.[2] || [];
  pick("index").replaceChildren(...indices.map((index) => option(index.replace(/^\[|\]$/g, "").replaceAll("][", ", "), index)));
  pick("index").hidden = indices.length < 2;
}

function want() {
  main.dataset.wants = signals.map((signal) => `plot:${signal.name}`).join(" ");
  const names = signals.map((signal) => signal.name).join(",");
  history.replaceState(null, "", `#${names}`);
  sessionStorage.setItem(KEY, names); // for when a person comes back to this page
  legend.replaceChildren(...signals.map((signal, i) => {
    const chip = Object.assign(document.createElement("button"), { type: "button", className: "chip", title: "Remove" });
    chip.style.borderColor = chip.style.color = COLOURS[i % COLOURS.length];
    chip.dataset.source = `plot:${signal.name}`;
    const age = Object.assign(document.createElement("span"), { className: "age" });
    chip.append(Object.assign(document.createElement("span"), { textContent: `${signal.name}  ` }), (signal.shown = document.createElement("b")), ` ${signal.unit} `, age, " ×");
    chip.onclick = () => ((signals = signals.filter((other) => other !== signal)), want(), draw());
    return chip;
  }));
}

function add(name) {
  const [topic, what] = name.split(".");
  const row = topics[topic]?.find((known) => known[0] === what?.replace(/\[.*$/, ""));
  if (!row || !row[2].includes(what.slice(row[0].length)) || signals.some((signal) => signal.name === name) || signals.length >= COLOURS.length) return false;
  signals.push({ name, unit: row[1].replace("|", " or "), t: [], v: [] });
  return true;
}

const EMPTY = { t: [], v: [] };
const line = (signal) => (isPast() ? (signal.past?.t ? signal.past : EMPTY) : signal);

function take() {
  let isDue = !isPaused || wasPast !== isPast();
  wasPast = isPast();
  if (wasPast) {
    const fresh = signals.filter((signal) => signal.past !== data(`plot:${signal.name}`));
    for (const signal of fresh) signal.past = data(`plot:${signal.name}`);
    if (fresh.length || isDue) draw();
    return;
  }
  for (const signal of signals) {
    const found = data(`plot:${signal.name}`);
    if (!found?.t || found === signal.seen) continue;
    signal.seen = found;
    // Nothing during a pause of any length, except the history of a signal added meanwhile.
    if (isPaused && signal.t.length) {
      signal.isCut = true;
      continue;
    }
    // A new connection repeats the history; a system that was started again has another clock.
    const last = signal.t.at(-1) ?? -Infinity;
    isDue ||= !signal.t.length;
    if (found.t.length && found.t.at(-1) < last) signal.t.length = signal.v.length = 0;
    const begin = signal.t.length ? first(found.t, last + 1e-6) : 0;
    if (signal.isCut && begin < found.t.length) {
      signal.isCut = false;
      signal.t.push(found.t[begin]);
      signal.v.push(null); // no line across a gap
    }
    for (let i = begin; i < found.t.length; i++) {
      signal.t.push(found.t[i]);
      signal.v.push(found.v[i]);
    }
    const newest = signal.t.at(-1) || 0;
    const old = first(signal.t, newest - KEPT_S - 2);
    if (old > 2000) (signal.t.splice(0, old), signal.v.splice(0, old));
    if (!isPaused) end = newest < end - KEPT_S ? newest : Math.max(end, newest);
  }
  if (isDue) draw();
}

const range = () => (pastView() ? [pastView().from, pastView().to] : zoom || [end - Number(pick("span").value), end]);
const LEFT = 78; // room for -0.000010
const timeAt = (x) => range()[0] + ((x - LEFT) / (canvas.clientWidth - LEFT)) * (range()[1] - range()[0]);
function first(list, t) {
  let [low, high] = [0, list.length];
  while (low < high) (list[(low + high) >> 1] < t ? (low = ((low + high) >> 1) + 1) : (high = (low + high) >> 1));
  return low;
}

// Faults, errors and warnings, as lines with words where there is room; in the past also the time that the page shows.
function events(paint, colour, at, width, height) {
  const [from, to] = range();
  const view = pastView();
  let free = LEFT;
  paint.textAlign = "left";
  for (const { t, kind, text } of [...marksIn(from, to, Boolean(view)), ...(view ? [{ t: view.at, kind: "now", text: "shown" }] : [])]) {
    const x = Math.max(LEFT, Math.round(at(t)));
    paint.fillStyle = colour(MARKS[kind]);
    paint.fillRect(x, 18, kind === "now" ? 2 : 1, height - 36);
    if (x < free || kind === "now") continue;
    const words = text.length > 60 ? `${text.slice(0, 58)}…` : text;
    free = x + paint.measureText(words).width + 12;
    paint.textAlign = free > width ? "right" : "left";
    paint.fillText(words, free > width ? x - 4 : x + 4, height - 4);
  }
}

function draw() {
  const ratio = devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const paint = canvas.getContext("2d", { willReadFrequently: true });
  const look = getComputedStyle(document.documentElement);
  const colour = (name) => look.getPropertyValue(name).trim();
  paint.setTransform(ratio, 0, 0, ratio, 0, 0);
  paint.fillStyle = colour("--card");
  paint.fillRect(0, 0, width, height);
  paint.font = "12px system-ui, sans-serif";
  const [from, to] = range();
  const at = (t) => LEFT + ((t - from) / (to - from)) * (width - LEFT);
  events(paint, colour, at, width, height);
  const units = [...new Set(signals.map((signal) => signal.unit))];
  const tall = (height - 18) / Math.max(1, units.length);
  units.forEach((unit, lane) => {
    const lines = signals.map((signal, i) => [signal, i]).filter(([signal]) => signal.unit === unit);
    let [low, high] = [Infinity, -Infinity];
    for (const [signal] of lines) {
      const { t, v } = line(signal);
      for (let i = first(t, from); i < t.length && t[i] <= to; i++) if (v[i] !== null) [low, high] = [Math.min(low, v[i]), Math.max(high, v[i])];
    }
    const [top, bottom] = [lane * tall + 18, (lane + 1) * tall - 4];
    paint.fillStyle = colour("--soft");
    paint.textAlign = "left";
    paint.fillText(unit || "no unit", LEFT, top - 5);
    paint.strokeStyle = colour("--line");
    paint.lineWidth = 1;
    paint.strokeRect(LEFT + 0.5, Math.round(top) + 0.5, width - LEFT - 1, Math.round(bottom - top));
    if (low > high) return;
    const least = Math.max(2e-5, Math.abs(high) * 1e-4);
    if (high - low < least) [low, high] = [low - least / 2, high + least / 2];
    const shown = (v) => v.toFixed(digits).replace(/^-(0\.?0*)$/, "$1");
    const digits = Math.max(0, Math.min(6, 2 - Math.floor(Math.log10(high - low))));
    paint.textAlign = "right";
    paint.fillText(shown(high), LEFT - 5, top + 10);
    paint.fillText(shown(low), LEFT - 5, bottom);
    const y = (v) => bottom - 3 - ((v - low) / (high - low)) * (bottom - top - 6);
    for (const [signal, i] of lines) {
      const { t: times, v: values } = line(signal);
      paint.strokeStyle = COLOURS[i % COLOURS.length];
      paint.lineWidth = 1.5;
      paint.beginPath();
      let [column, min, max, before] = [-1, 0, 0, null];
      // Several samples a pixel: a stroke from their least to their greatest.
      for (let k = Math.max(0, first(times, from) - 1); k < times.length && times[k] <= to; k++) {
        const v = values[k];
        if (v === null) { before = null; continue; }
        const x = Math.round(at(times[k]));
        if (x < LEFT) { before = null; continue; }
        if (before === null || times[k] - before > 0.5) (paint.moveTo(x, y(v)), ([min, max] = [v, v]));
        else if (x !== column) {
          if (column >= LEFT && max > min) (paint.moveTo(column, y(min)), paint.lineTo(column, y(max)), paint.moveTo(column, y(values[k - 1] ?? v)));
          paint.lineTo(x, y(v));
          [min, max] = [v, v];
        } else [min, max] = [Math.min(min, v), Math.max(max, v)];
        [column, before] = [x, times[k]];
      }
      paint.stroke();
    }
  });
  paint.fillStyle = colour("--soft");
  paint.textAlign = signals.length ? "left" : "center";
  if (signals.length) paint.fillText(`${(to - from).toFixed(2)} s`, LEFT, height - 4);
  else paint.fillText("Choose a record and a field above, and add it.", width / 2, height / 2);
  if (drag) {
    paint.fillStyle = "#6aa9ff33";
    paint.fillRect(Math.min(drag[0], drag[1]), 18, Math.abs(drag[1] - drag[0]), height - 36);
  }
  if (cursor !== null && cursor > LEFT) {
    paint.strokeStyle = colour("--soft");
    paint.beginPath();
    paint.moveTo(cursor, 18);
    paint.lineTo(cursor, height - 18);
    paint.stroke();
    paint.textAlign = "right";
    paint.fillText(`${(timeAt(cursor) - to).toFixed(3)} s`, width - 6, height - 4);
  }
  for (const signal of signals) {
    const { t, v: values } = line(signal);
    const there = cursor !== null && cursor > LEFT ? timeAt(cursor) : pastView()?.at ?? Infinity;
    const v = values[Math.min(first(t, there), t.length - 1)];
    const text = typeof v === "number" ? v.toPrecision(5) : "–";
    if (signal.shown && signal.shown.textContent !== text) signal.shown.textContent = text;
  }
}

function save(name, url) {
  Object.assign(document.createElement("a"), { href: url, download: name }).click();
}

function csv() {
  const [from, to] = range();
  const times = [...new Set(signals.flatMap((signal) => line(signal).t.slice(first(line(signal).t, from), first(line(signal).t, to + 1e-9))))].sort((a, b) => a - b);
  const maps = signals.map((signal) => new Map(line(signal).t.map((t, i) => [t, line(signal).v[i]])));
  const quoted = (text) => (/[",]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const head = [isPast() ? "time_of_day_s" : "stamp_s", ...signals.map((signal) => quoted(`${signal.name} ${signal.unit}`.trim()))].join(",");
  return [head, ...times.map((t) => [t, ...maps.map((map) => map.get(t) ?? "")].join(","))].join("\n");
}

const DOES = {
  add: (button) => add(`${pick("topic").value}.${pick("field").value}${pick("index").value}`) ? (want(), draw()) : note(button, "bad", `It is already shown, or there are ${COLOURS.length} signals.`),
  pause: (button) => {
    isPaused = !isPaused;
    button.textContent = isPaused ? "Resume" : "Pause";
    button.classList.toggle("on", isPaused);
    zoom = null;
    draw();
  },
  whole: () => ((zoom = null), draw()),
  csv: () => save("plot.csv", URL.createObjectURL(new Blob([csv()], { type: "text/csv" }))),
  png: () => save("plot.png", canvas.toDataURL("image/png")),
};
page.addEventListener("click", (event) => {
  const button = event.target.closest("button[data-plot]");
  if (button) DOES[button.dataset.plot](button);
});
page.addEventListener("change", (event) => {
  if (event.target === pick("topic")) fillFields();
  else if (event.target === pick("field")) fillIndexes();
  draw();
});
const x = (event) => event.clientX - canvas.getBoundingClientRect().left;
canvas.addEventListener("pointermove", (event) => {
  cursor = x(event);
  if (drag) drag[1] = cursor;
  draw();
});
canvas.addEventListener("pointerleave", () => ((cursor = null), draw()));
canvas.addEventListener("pointerdown", (event) => isPaused && !isPast() && (drag = [x(event), x(event)]));
window.addEventListener("pointerup", () => {
  if (drag && Math.abs(drag[1] - drag[0]) > 8) zoom = [Math.min(...drag), Math.max(...drag)].map(timeAt);
  drag = null;
  draw();
});
canvas.addEventListener("dblclick", () => DOES.whole());
new ResizeObserver(draw).observe(canvas);

pick("topic").replaceChildren(...Object.keys(topics).map((name) => option(name, name)));
if (page.dataset.first) pick("topic").value = page.dataset.first;
fillFields();
if (field()?.[0] !== "position" && topics[page.dataset.first]?.some((row) => row[0] === "position")) (pick("field").value = "position"), fillIndexes();
keeps(() => isPaused && signals.some((signal) => signal.t.length) && "the paused plot");
for (const name of (decodeURIComponent(location.hash.slice(1)) || sessionStorage.getItem(KEY) || "").split(",").filter(Boolean)) add(name);
want();
onTick(take);
page.plots = { add: (name) => add(name) && (want(), draw()), signals: () => signals, zoom: () => zoom, csv };
