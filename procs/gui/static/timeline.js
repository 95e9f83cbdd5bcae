// The timeline: the whole page goes back to an earlier time, and shows clearly that it does. Stop and Power off act on the present.
import { ask, cell, isConnected, isPast, note, now, present, rewind, wants } from "./live.js";

const at = (id) => document.getElementById(id);
const bar = at("timeline");
const slider = at("time");
const BEFORE_MS = 500; // a fault's button goes to the moment before it
const NEAR_MS = 60000; // around a fault, its words are shown
const POINTS = 1500;
const AGAIN_MS = 500; // without a connection
const KEPT_MS = 5000; // so long a change of pages may take
let aim = null; // the time to show, ms; null: the present
let shownAt = null; // the time that is shown
let view = null; // { at, from, to } of plots, s
let isKnown = true; // whether anything is recorded of that time
let asked = "";
let isAsking = false;

const marks = () => present("timeline")?.marks || [];
const faults = () => marks().filter((mark) => mark.kind === "fault");

// Marks of events in a span of a plot, s: of times of day in the past, else of the system's time.
export const marksIn = (from, to, isOfPast) => marks().map((mark) => ({ ...mark, t: isOfPast ? mark.at / 1000 : mark.t })).filter(({ t }) => t >= from && t <= to);
export const pastView = () => (isPast() ? view : null);

// --- words

export function lasting(ms) {
  const s = Math.max(0, ms / 1000);
  if (s < 10) return `${s.toFixed(1)} s`;
  if (s < 60) return `${Math.floor(s)} s`;
  if (s < 3600) return `${Math.floor(s / 60)} min ${Math.floor(s % 60)} s`;
  return `${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
}
const clock = (ms) => `${new Date(ms).toLocaleTimeString("en-GB")}.${String(Math.floor(ms % 1000)).padStart(3, "0")}`;
const named = (fault) => (fault.text.startsWith(fault.from) ? fault.text : `${fault.from}: ${fault.text}`);

function nearest(ms) {
  const near = faults().filter((fault) => Math.abs(fault.at - ms) <= NEAR_MS);
  return near.sort((a, b) => Math.abs(a.at - ms) - Math.abs(b.at - ms))[0];
}

// --- asking

const span = () => 1000 * Math.min(60, Number((at("plot-span") || at("span"))?.value) || 10);

async function look() {
  if (isAsking) return;
  isAsking = true;
  while (aim !== null) {
    const mine = aim;
    const to = Math.min(Math.round(mine + span() / 4), Math.round(now()));
    const sources = wants(true);
    asked = sources.join(" ") + span();
    const from = Math.min(to, Math.round(mine - (3 * span()) / 4));
    const [outcome, found] = await ask({ op: "past", at: mine, from, to, points: POINTS, sources });
    if (aim === null) break;
    if (outcome === "lost") {
      await new Promise((go) => setTimeout(go, AGAIN_MS));
      continue;
    }
    if (outcome !== "done") {
      note(slider, "bad", `The past cannot be shown: ${found}`);
      if (!isPast()) aim = null;
      break;
    }
    shownAt = mine;
    view = { at: mine / 1000, from: from / 1000, to: to / 1000 };
    isKnown = found.known;
    rewind(found.data);
    refresh();
    if (aim === mine) break;
  }
  isAsking = false;
  refresh();
}

export function goTo(ms) {
  if (now() === null) return;
  if (ms > now() - 100) return live();
  aim = Math.round(ms);
  look();
}

export function live() {
  aim = shownAt = view = null;
  rewind(null);
  refresh();
}

// --- what is shown

function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function banner() {
  at("past").hidden = shownAt === null;
  if (shownAt === null) {
    delete document.body.dataset.past;
    if (document.title.startsWith("PAST")) document.title = document.title.replace(/^PAST · /, "");
    return;
  }
  document.body.dataset.past = "";
  if (!document.title.startsWith("PAST")) document.title = `PAST · ${document.title}`;
  put(at("past-when"), `${lasting(now() - shownAt)} ago`);
  put(at("past-clock"), clock(shownAt));
  const fault = nearest(shownAt);
  const apart = fault && fault.at - shownAt;
  const words = isKnown ? "" : "Nothing is recorded of this time. ";
  put(at("past-what"), words + (fault ? `${lasting(Math.abs(apart))} ${apart > 0 ? "before" : "after"} the fault ${named(fault)}` : ""));
  const file = at("past-file");
  file.hidden = !fault?.file;
  if (fault?.file && file.dataset.file !== fault.file) {
    file.dataset.file = fault.file;
    file.href = `/files/recordings/${encodeURIComponent(fault.file)}`;
    put(file, `Save its recording (${(fault.size / 1e6).toFixed(1)} MB)`);
  }
  const inFault = present("timeline")?.now || [];
  put(at("past-news"), inFault.length ? `Now: ${inFault.join(", ")} ${inFault.length > 1 ? "are" : "is"} in FAULT` : "");
}

let listed = "";
function buttons() {
  const found = faults().toReversed();
  const key = found.map((fault) => `${fault.at} ${fault.text}`).join();
  if (key !== listed) {
    listed = key;
    at("faults").replaceChildren(...found.map((fault) => {
      const button = cell("button", "", "fault-mark");
      Object.assign(button, { type: "button", title: `${clock(fault.at)} ${named(fault)}` });
      button.dataset.at = fault.at;
      button.append(cell("b", `${fault.from} fault`), " ", cell("span", ""));
      button.onclick = () => goTo(fault.at - BEFORE_MS);
      return button;
    }));
  }
  for (const button of at("faults").children) put(button.lastChild, `${lasting(Math.max(1000, now() - button.dataset.at)).replace(/\.\d/, "")} ago`);
}

let drawn = "";
function ticks() {
  const begin = +slider.min;
  const places = marks().map((mark) => [(1 - (now() - mark.at) / 1000 / -begin) * 100, mark.kind]).filter(([x]) => x >= 0 && x <= 100);
  const key = places.map(([x, kind]) => x.toFixed(0) + kind).join();
  if (key === drawn) return;
  drawn = key;
  at("time-marks").replaceChildren(...places.map(([x, kind]) => {
    const tick = cell("i", "");
    tick.dataset.kind = kind;
    tick.style.left = `${x}%`;
    return tick;
  }));
}

function refresh() {
  if (now() === null) return;
  const begin = present("timeline")?.begin || 0;
  const oldest = Math.min(begin || now() - 2000, aim ?? Infinity);
  slider.min = -Math.max(2, Math.ceil((now() - oldest) / 1000));
  slider.value = aim === null ? 0 : (aim - now()) / 1000;
  const text = aim === null ? (isConnected() ? "live" : "no connection") : aim === shownAt ? `${lasting(now() - aim)} ago` : "loading…";
  put(at("time-shown"), text);
  if (slider.getAttribute("aria-valuetext") !== text) slider.setAttribute("aria-valuetext", text);
  at("live").classList.toggle("on", aim === null && isConnected());
  put(at("time-begin"), `${lasting(-1000 * slider.min).replace(/ \d+ s$/, "")} ago`);
  buttons();
  ticks();
  banner();
}

// --- what people do

slider.addEventListener("input", () => goTo(now() + 1000 * +slider.value));
slider.addEventListener("keydown", (event) => {
  const steps = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 };
  const step = steps[event.key];
  if (step) goTo((aim ?? now()) + 1000 * step * (event.shiftKey ? 0.1 : 1));
  else if (event.key === "Home") goTo(now() + 1000 * +slider.min);
  else if (event.key === "End") live();
  else return;
  event.preventDefault();
});
for (const id of ["live", "past-live"]) at(id).addEventListener("click", live);

// Another page of this tab shows the same time; a page that is loaded again shows the present.
window.addEventListener("pagehide", () => aim !== null && sessionStorage.setItem("past", JSON.stringify([aim, Date.now()])));
const [before, left] = JSON.parse(sessionStorage.getItem("past") || "[0, 0]");
sessionStorage.removeItem("past");
const isReload = performance.getEntriesByType("navigation")[0]?.type === "reload";
let wanted = !isReload && Math.abs(Date.now() - left) < KEPT_MS ? before : 0;

setInterval(() => {
  if (wanted && now() !== null) {
    goTo(wanted);
    wanted = 0;
  }
  if (aim !== null && !isAsking && asked !== wants(true).join(" ") + span()) look(); // a plot was added
  refresh();
}, 250);
bar.timeline = { goTo, live, at: () => shownAt, view: () => view };
