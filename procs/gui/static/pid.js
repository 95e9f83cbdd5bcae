// The page PID: gains that are edited and applied, the plot of one joint, and a step to try them.
import { confirmed, data, denied, hasControl, isPast, note, onTick, perform, pressed, sourceAge, value } from "./live.js";
import { marksIn, pastView } from "./timeline.js";
import { Trace } from "./trace.js";
import { perUnit, typed, unit } from "./units.js";

const TEXT = 64; // letters of a command's text
const page = document.getElementById("pid");
const { io, robot, arm, gains, traces } = page.dataset;
const inputs = [...page.querySelectorAll("[data-gain]")];
const at = (id) => document.getElementById(id);
const shownAs = (v) => String(+v.toPrecision(9));
const inUse = (input) => value(`${gains}.${input.dataset.gain}.${input.dataset.axis}`);
const axisName = (input) => at("axis").options[+input.dataset.axis].textContent;

// --- gains

function wanted(input) {
  const v = typed(input.value);
  const { low, high, above } = input.dataset;
  return v === null || v < +low || v > +high || (above !== undefined && v === +low) ? null : v;
}

function changed() {
  return inputs.filter((input) => input.dataset.edited !== undefined);
}

function follow() {
  for (const input of inputs) {
    let v = inUse(input);
    if (v === undefined || v === null) continue;
    v = Number(v);
    if (input.dataset.edited === undefined && document.activeElement !== input) {
      const text = shownAs(v);
      if (input.value !== text) input.value = text;
    }
    input.classList.toggle("other", v !== +input.dataset.file && input.dataset.edited === undefined);
  }
}

function edited(input) {
  const v = wanted(input);
  const same = v !== null && shownAs(v) === shownAs(Number(inUse(input)));
  if (same) delete input.dataset.edited;
  else input.dataset.edited = "";
  input.classList.toggle("wrong", v === null);
  input.classList.toggle("edited", !same);
  remember();
}

// Edits outlive the page: a person who comes back finds them, not applied as before.
const KEY = `gains ${document.title} ${location.pathname}`; // with the name of the system
function remember() {
  const found = changed();
  at("edited").textContent = found.length ? `${found.length} changed, not applied` : "nothing changed";
  sessionStorage.setItem(KEY, JSON.stringify(found.map((input) => [input.dataset.gain, input.dataset.axis, input.value])));
}

function recall() {
  for (const [gain, axis, text] of JSON.parse(sessionStorage.getItem(KEY) || "[]")) {
    const input = inputs.find(({ dataset }) => dataset.gain === gain && dataset.axis === axis);
    if (!input) continue;
    input.value = text;
    edited(input);
  }
}

function discard() {
  for (const input of changed()) {
    delete input.dataset.edited;
    input.classList.remove("edited", "wrong");
  }
  remember();
  follow();
}

async function apply(button) {
  const found = changed();
  if (denied(button)) return;
  if (!found.length) return note(button, "bad", "Nothing was changed.");
  const wrong = found.find((input) => wanted(input) === null);
  if (wrong) return note(button, "bad", wrong.title);
  const words = found.map((input) => `${input.dataset.gain} of ${axisName(input)}: ${shownAs(Number(inUse(input)))} → ${shownAs(wanted(input))}`);
  const on = value(`${page.querySelector("[data-switch]").dataset.switch}`);
  const when = pressed();
  if (!(await confirmed(`${on ? "The joint controller is on: the arm may move.\n" : ""}${words.join("\n")}`)) || denied(button)) return;
  if (on !== value(page.querySelector("[data-switch]").dataset.switch)) return apply(button); // the question was about the other case
  const steps = [];
  for (const input of found) {
    const { gain, axis } = input.dataset;
    const last = steps.at(-1)?.[0];
    // Of one axis as many at once as have room in a command.
    if (last && last[2][0] === +axis && `${last[3]} ${gain}`.length <= TEXT) {
      last[2].push(wanted(input));
      last[3] = `${last[3]} ${gain}`;
    } else steps.push([[io, "set_gains", [+axis, wanted(input)], `${robot} @gui ${gain}`]]);
  }
  if (await perform(button, steps, when)) discard();
}

for (const input of inputs)
  for (const name of ["input", "change"]) input.addEventListener(name, () => edited(input));
inputs.forEach((input) => input.addEventListener("keydown", (event) => event.key === "Enter" && apply(at("apply"))));
at("apply").addEventListener("click", (event) => apply(event.currentTarget));
at("discard").addEventListener("click", discard);
at("all-gains").addEventListener("click", () => page.classList.toggle("all"));

// If a file cannot be made, show the reason instead of an invalid page.
at("save").addEventListener("click", async (event) => {
  event.preventDefault();
  const link = event.currentTarget;
  if (link.dataset.waits !== undefined) return;
  link.dataset.waits = "";
  try {
    const answer = await fetch(link.href);
    if (!answer.ok) return note(link, "bad", await answer.text());
    const saved = Object.assign(document.createElement("a"), { href: URL.createObjectURL(await answer.blob()), download: `PID-${robot}.json` });
    saved.click();
    URL.revokeObjectURL(saved.href);
    note(link, "good", answer.headers.get("x-notes") || `PID-${robot}.json`);
  } catch {
    note(link, "bad", "not connected");
  } finally {
    delete link.dataset.waits;
  }
});

// --- plot

const trace = new Trace(at("trace"));
const before = new Trace(at("trace"), 0.5); // of the past
let taken = null;
let paused = false;
let first = 0;
const slides = () => at("axis").selectedOptions[0].dataset.slides === "p";

function choose() {
  page.dataset.wants = `${arm}/state ${arm}/audit ${gains} ${traces}${at("axis").value}`;
  trace.clear();
}

const DRAW_MS = 100;
let drawn = 0;
let isDue = false;
function draw() {
  if (isDue) return;
  isDue = true;
  requestAnimationFrame((now) => {
    isDue = false;
    if (now - drawn >= DRAW_MS) {
      drawn = now;
      paint();
    }
  });
}

function paint() {
  const chosen = [...page.querySelectorAll(".legend input:checked")].map((box) => +box.value);
  const view = pastView();
  const marks = view ? marksIn(view.from, view.to, true).map(({ t, kind }) => [t - view.from, kind]) : marksIn(first, Infinity, false).map(({ t, kind }) => [t - first, kind]);
  if (view) marks.push([view.at - view.from, "now"]);
  (view ? before : trace).draw(chosen, +at("span").value, perUnit(slides()), unit(slides()), slides() ? "N" : "N·m", marks);
}

function take() {
  const found = data(`${traces}${at("axis").value}`);
  if (found === taken) return;
  taken = found;
  const view = pastView();
  if (view) {
    before.clear();
    if (found?.t) before.add(found.t.map((t) => t - view.from), found.v);
    return draw();
  }
  if (!found?.t || paused) return;
  first ||= found.t[0];
  trace.add(found.t.map((t) => t - first), found.v);
}

function pause(on) {
  if (paused && !on) trace.clear();
  paused = on;
  at("pause").textContent = on ? "Resume" : "Pause";
}

at("axis").addEventListener("change", () => (choose(), pause(false)));
at("pause").addEventListener("click", () => pause(!paused));
page.addEventListener("change", () => ((drawn = 0), draw()));

// --- a step, and back

async function step(button) {
  const [size, time] = [typed(at("step-size").value), typed(at("step-time").value)];
  const most = +at("step-size").dataset.most;
  const word = slides() ? "mm" : "°";
  const axis = +at("axis").value;
  const joints = value(`${arm}/state.count`);
  if (denied(button)) return;
  if (size === null || !size || Math.abs(size) > most) return note(button, "bad", `A step of up to ${most} ${word}, not 0, is needed.`);
  if (time === null || time < 0.1 || time > 5) return note(button, "bad", "A time from 0.1 to 5 s is needed.");
  if (!(axis < joints)) return note(button, "bad", `${arm} has no joint of that number now.`);
  const when = pressed();
  if (!(await confirmed(`${arm}, ${at("axis").selectedOptions[0].textContent} jumps by ${size} ${word}, and back after ${time} s. Continue?`)) || denied(button)) return;
  const change = slides() ? size / 1000 : (size * Math.PI) / 180;
  const by = (v) => [[arm, "servo_jr", Array.from({ length: joints }, (_, i) => (i === axis ? v : 0)), ""]];
  pause(false);
  const begun = performance.now();
  isStopped = false;
  if (!(await perform(button, [by(change)], when))) return;
  const there = await stepped();
  await sleep(time * 1000 - (performance.now() - begun));
  const why = meanwhile(there);
  if (why) note(button, "bad", `It does not step back: ${why}. The arm stays where it is.`);
  else await perform(button, [by(-change)]);
  await sleep(1000);
  pause(true); // it stays to be looked at
}

const sleep = (ms) => new Promise((go) => setTimeout(go, ms));
const request = () => data(`${arm}/audit`);
const setpoint = () => [...(value(`${arm}/state.setpoint_position`) || [])];
let isStopped = false;

// The setpoint after our step; null where the arm was asked for anything else.
async function stepped() {
  for (let k = 0; k < 20 && !isOurs(request()); k++) await sleep(50);
  await sleep(100); // the display is now at least as new as the step
  return isOurs(request()) ? setpoint() : null;
}

// Of a stream only its first row is written: this one, or that of a step before.
const isOurs = (row) => row?.command === "servo_jr" && row.program === "gui" && row.outcome !== "refused";

// Why the step must not continue; empty: all is unchanged since its first half.
function meanwhile(before) {
  const row = request();
  const on = page.querySelector("[data-switch]").dataset.switch;
  if (isStopped) return "it was stopped";
  if (!hasControl()) return "this page has lost control";
  if (!(sourceAge(`${arm}/state`) < 1)) return `${arm} sends no data`;
  if (value(`${arm}/state.state`) !== "ENABLED" || !value(on)) return `${arm} is no longer enabled`;
  if (!isOurs(row)) return `${arm} received ${row?.command} ${row?.text}`.trim();
  return before && setpoint().every((v, i) => Math.abs(v - before[i]) < 1e-6) ? "" : "the setpoint has changed";
}

// Whatever stops something: also Power off by its key.
document.addEventListener("click", ({ target }) => target.closest("[data-free]") && (isStopped = true), true);
at("step").addEventListener("click", (event) => step(event.currentTarget));

choose();
let isRecalled = false;
let wasPast = false;
onTick(() => {
  if (!isRecalled && data(gains)) {
    isRecalled = true;
    recall();
  }
  follow();
  take();
  if (!paused || isPast() !== wasPast) draw();
  wasPast = isPast();
  const word = slides() ? "mm" : "°";
  if (at("step-unit").textContent !== word) at("step-unit").textContent = word;
});
