// One connection a page: data come in one message a tick, commands go out, answers are shown where one pressed.
// Attributes define the content of elements, see procs/gui/pages/parts.py.
import { turns } from "./pose.js";
import { inUnits, onUnits, turnUnits, unit, units } from "./units.js";

const sources = {}; // newest data by source
let past = null; // the data of another time, while the page shows that
const heard = {}; // when each source last changed, ms
let socket = null;
const { run } = document.documentElement.dataset; // the name of the pages that this one is of
let you = false;
let holder = "";
let lastTick = 0;
let tick = 0; // the number of the newest one
let refused = ""; // the server's reason for ending the connection, if it gave one
let lost = ""; // why this page lost control, until it has it again or a person has seen that
let expected = 0; // until when control is expected after a change of pages, ms
let isGiven = false; // a person has given control back
const KEPT_MS = 5000; // control is kept that long while a person changes pages
let number = 0;
const waiting = new Map(); // commands without an end
const listeners = []; // called after each tick, and when the page goes to another time

export const data = (name) => (past ?? sources)[name];
export const present = (name) => sources[name];
export const onTick = (listener) => listeners.push(listener);
export const isPast = () => past !== null;
export const hasControl = () => you && !past; // what a person sees of the past is no ground to command something now
const storeOf = (element) => (past && !element.closest("[data-present]") ? past : sources);

// Why this page may command nothing but stops, beside the button; false: it may.
export function denied(button) {
  const why = past ? "This page shows the past: return to live first." : you ? "" : "Take control first: this page is read-only.";
  if (why) note(button, "bad", why);
  return Boolean(why);
}

// Show the data of another time, by source; null: the present.
export function rewind(found) {
  if (found && !past) window.dispatchEvent(new Event("blur")); // ends what is held
  past = found;
  refreshed();
}

// All views at once. An error of one is reported, and stops no other one.
function refreshed() {
  shown();
  for (const listener of listeners) {
    try {
      listener();
    } catch (error) {
      reportError(error);
    }
  }
}

// --- values

export function value(path, from = past ?? sources) {
  const dot = path.indexOf(".");
  let found = from[dot < 0 ? path : path.slice(0, dot)];
  if (dot >= 0) for (const part of path.slice(dot + 1).split(".")) found = found?.[part];
  return found;
}

export const fixed = (v, digits) => {
  const text = v.toFixed(digits);
  return /^-0\.?0*$/.test(text) ? text.slice(1) : text; // no flicker between 0.0 and -0.0
};

const FORMATS = {
  text: (v) => String(v),
  num: (v, digits = 2) => fixed(v, +digits),
  deg: (v, digits = 1) => fixed((v * 180) / Math.PI, +digits),
  mm: (v, digits = 1) => fixed(v * 1000, +digits),
  pct: (v, digits = 0) => fixed(v * 100, +digits),
  time: (v) => new Date(v).toLocaleTimeString("en-GB"),
  yes: (v, yes = "yes", no = "no") => (v ? yes : no),
  turn: (v, axis) => (v.every?.((x) => typeof x === "number") ? fixed((turns(v.slice(3))[+axis] * 180) / Math.PI, 1) : "–"), // of a pose
  joint: (v, slides) =>
    slides === "p" ? (units() === "deg" ? fixed(v * 1000, 2) : fixed(v, 5)) : units() === "deg" ? fixed((v * 180) / Math.PI, 2) : fixed(v, 4),
};

function formatted(v, format) {
  if (v === null || v === undefined || v === "") return "–";
  const [name, ...rest] = (format || "text").split(":");
  if (name !== "text" && name !== "yes" && name !== "turn" && typeof v !== "number") return "–";
  return FORMATS[name](v, ...rest);
}

// `a.b.c`, `!a.b.c`, `a.b.c=WORD|WORD`, `a.b.c>3`, `a.b.c~part of a text`
function holds(condition, from) {
  const match = /^(!?)([^=><~]+)(?:([=><~])(.*))?$/.exec(condition);
  const v = value(match[2], from);
  let result;
  if (match[3] === "=") result = match[4].split("|").includes(String(v));
  else if (match[3] === ">") result = v > +match[4];
  else if (match[3] === "<") result = v < +match[4];
  else if (match[3] === "~") result = Boolean(v?.includes(match[4]));
  else result = Boolean(v);
  return match[1] ? !result : result;
}

const sourceOf = (path) => path.replace(/^!/, "").split(/[.=><]/)[0];

export function sourceAge(name, from = past ?? sources) {
  const found = from[name];
  if (!found || found.age === null || found.age === undefined) return null;
  if (from === past) return found.age;
  return found.age + (performance.now() - (isConnected() ? Math.max(lastTick, 0) : heard[name] || 0)) / 1000;
}

const STALE_S = 1.0;

function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function isOn(element, is) {
  element.classList.toggle("on", is);
  if (element.tagName === "BUTTON") element.setAttribute("aria-pressed", String(is));
}

export function render() {
  const connected = isConnected();
  for (const element of document.querySelectorAll("[data-live]")) {
    const known = element.closest("[data-valid]");
    const from = storeOf(element);
    const isUnknown = known && (element.dataset.format || "text") !== "text" && !value(known.dataset.valid, from);
    const v = isUnknown ? null : value(element.dataset.live, from);
    put(element, formatted(v, element.dataset.format));
    if (element.dataset.tone !== undefined) element.dataset.tone = v === undefined || v === null ? "" : String(v);
  }
  for (const element of document.querySelectorAll("[data-show]")) element.hidden = !holds(element.dataset.show, storeOf(element));
  for (const element of document.querySelectorAll("[data-on]")) isOn(element, holds(element.dataset.on, storeOf(element)));
  for (const element of document.querySelectorAll("[data-unit]")) put(element, unit(element.dataset.unit === "p"));
  for (const element of document.querySelectorAll("[data-source]")) {
    const from = storeOf(element);
    const age = sourceAge(element.dataset.source, from);
    const stale = !connected || age === null || age > STALE_S || Boolean(from[element.dataset.source]?.gone);
    element.classList.toggle("stale", stale);
    const label = element.querySelector(":scope .age");
    if (label) put(label, !stale ? "" : age === null ? "no data" : `${age < 10 ? age.toFixed(1) : age.toFixed(0)} s old`);
  }
}

// --- connection

export const isConnected = () => socket?.readyState === 1 && performance.now() - lastTick < 1500;

export function wants(ofPast = false) {
  if (document.hidden) return [];
  const isShown = (part) => !part.closest(`[data-panel][hidden]${ofPast ? ", [data-present]" : ""}`); // a closed panel costs nothing
  const found = new Set([...document.querySelectorAll("[data-wants]")].filter(isShown).flatMap((part) => part.dataset.wants.split(" ").filter(Boolean)));
  for (const name of ["live", "show", "on", "source", "valid"])
    for (const element of document.querySelectorAll(`[data-${name}]`)) if (isShown(element)) found.add(name === "source" ? element.dataset.source : sourceOf(element.dataset[name]));
  // A page without data is at least informed that it is connected, and which page has control.
  return found.size ? [...found].sort() : ["messages"];
}

let wanted = "";
export function want() {
  const list = wants();
  if (socket?.readyState !== 1 || wanted === list.join(" ")) return;
  wanted = list.join(" ");
  say({ op: "want", sources: list });
}

// A request carries the newest tick that the page has received, which tells the server its maximum age.
// While it shows the past, that is none: the server refuses all commands but those that stop something.
const DATED = { beat: () => tick, jog: () => (past ? 0 : tick), call: () => (past ? 0 : tick) };
export const say = (message) => socket?.readyState === 1 && socket.send(JSON.stringify(DATED[message.op] ? { ...message, tick: DATED[message.op]() } : message));

let offset = null; // from this page's clock to the system's time of day, ms
export const now = () => (offset === null ? null : performance.now() + offset);

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live?run=${run}`);
  let isGreeted = false;
  socket.onopen = () => {
    wanted = "";
    tick = 0;
    want();
  };
  socket.onmessage = (event) => {
    isGreeted = true;
    heed(JSON.parse(event.data));
  };
  socket.onclose = (event) => {
    refused = event.reason;
    if (you) lost = "the connection was interrupted";
    you = false;
    holder = "";
    for (const [, call] of waiting) call("lost", "the connection was lost; the outcome is unknown");
    waiting.clear();
    shown();
    if (!isGreeted) askAgain();
    setTimeout(connect, 700);
  };
}

// If we are refused: is another token needed now? Then open the page that requests it.
async function askAgain() {
  const answer = await fetch(import.meta.url, { method: "HEAD", cache: "no-store" }).catch(() => null);
  if (answer?.status === 401) outdated();
}

// What a page holds that loading it again would drop; each function returns it in words, or nothing.
const keepers = [];
export const keeps = (keeper) => keepers.push(keeper);
const kept = () => keepers.map((keeper) => keeper()).filter(Boolean).join(", ");
window.addEventListener("beforeunload", (event) => !isOutdated && kept() && event.preventDefault());

// The server has other pages now, or needs another token. A person decides when a page is dropped that holds something.
let isOutdated = false;
function outdated() {
  if (isOutdated) return;
  isOutdated = true;
  if (!kept()) location.reload();
  else document.getElementById("reload").hidden = false;
}

function heed(message) {
  if (message.op === "hello") {
    lastTick = performance.now();
    offset = message.now - lastTick;
    if (run !== message.run) outdated();
    for (const [id, steps] of [["power-off", message.power_off], ["stop", message.stop]]) document.getElementById(id).dataset.steps = JSON.stringify(steps); // also on an outdated page
    // A person who changes pages in one tab keeps control, unless another page has taken it meanwhile.
    const before = Number((run === message.run && sessionStorage.getItem("control")) || 0);
    sessionStorage.removeItem("control");
    const since = Date.now() - before; // by the time of day, which may have been set back
    if (before && since >= 0) {
      if (since < KEPT_MS) expected = lastTick + 1000;
      else lost = "changing pages took too long";
    }
  } else if (message.op === "tick") {
    lastTick = performance.now();
    tick = message.id;
    for (const [name, found] of Object.entries(message.data)) {
      sources[name] = found;
      heard[name] = lastTick;
    }
    const isMissed = expected && lastTick > expected;
    if (message.you) lost = "";
    else if (isMissed || (you && !isGiven)) lost = message.control ? `${message.control} took it` : "this page was silent for too long";
    if (message.you || isMissed) expected = 0;
    if (expected && !message.control) say({ op: "control", take: true, person: person() }); // the page before was still there
    isGiven &&= message.you;
    you = message.you;
    holder = message.control;
    refreshed();
  } else if (message.op === "past") {
    waiting.get(message.id)?.("done", message);
    waiting.delete(message.id);
  } else if (message.op === "reply") {
    const call = waiting.get(message.id);
    if (call) {
      call(message.outcome, message.text || "");
      if (message.outcome !== "accepted") waiting.delete(message.id);
    }
  }
}

// Actions of a page without control: disabled, but they explain why when they are pressed.
const commands = document.getElementsByClassName("commands");
let marked = "";
function mark() {
  const key = `${hasControl()} ${commands.length}`;
  if (key === marked) return;
  marked = key;
  for (const button of commands) hasControl() ? button.removeAttribute("aria-disabled") : button.setAttribute("aria-disabled", "true");
}

// Nothing can be sent: a red bar, and buttons that look so.
function offline() {
  const silent_s = Math.floor((performance.now() - lastTick) / 1000);
  const isOff = !isConnected() && silent_s >= 2;
  const why = refused ? `${refused}. ` : "";
  const rest = "Power off cannot be sent: use the emergency stop.";
  document.getElementById("offline").hidden = !isOff;
  put(document.querySelector("#offline .lost"), isOff ? `${why || "No connection. "}${rest}` : "");
  put(document.querySelector("#offline .since"), `${why || `No connection for ${silent_s} s. `}${rest}`);
}

function shown() {
  document.body.dataset.connection = isConnected() ? "live" : "lost";
  offline();
  mark();
  const without = document.getElementById("control-lost");
  put(without, lost && `Control lost: ${lost} ×`);
  without.hidden = !lost;
  document.body.dataset.control = you ? "you" : holder ? "other" : "none";
  const button = document.getElementById("control");
  if (localStorage.getItem("first-steps") === "closed") document.getElementById("first-steps")?.remove();
  put(button, you ? "Give back" : holder ? "Take over" : "Take control");
  button.title = you ? "Give control back" : holder ? `${holder} has control` : "This page is read-only until then";
  put(document.getElementById("holder"), !isConnected() ? "Control: unknown" : you ? `Control: you, ${holder}` : holder ? `Control: ${holder}` : "Control: free");
  render();
}

// --- commands

// A message that is answered; resolves with outcome and text of the last answer.
export function ask(message, told = () => {}) {
  const id = ++number;
  return new Promise((resolve) => {
    const heardOf = (outcome, reason) => {
      told(outcome, reason);
      if (outcome !== "accepted") resolve([outcome, reason]);
    };
    if (socket?.readyState !== 1) return heardOf("lost", "not connected");
    waiting.set(id, heardOf);
    say({ ...message, id });
  });
}

export const call = (to, command, values, text, told, since = 0) => ask({ op: "call", to, command, values: values || [], text: text || "", since }, told);

export const send = (to, command, values) => say({ op: "call", to, command, values }); // of a stream, as above

let noted = null;
export function note(element, kind, text) {
  noted?.remove();
  noted = document.createElement("div");
  noted.className = `note ${kind}`;
  noted.setAttribute("role", kind === "bad" ? "alert" : "status");
  noted.textContent = inUnits(text);
  document.body.append(noted);
  const at = (element.hidden ? document.getElementById("power-off") : element).getBoundingClientRect(); // pressed by its key
  const box = noted.getBoundingClientRect();
  noted.style.left = `${Math.max(8, Math.min(innerWidth - box.width - 8, at.left))}px`;
  noted.style.top = `${at.bottom + box.height + 12 < innerHeight ? at.bottom + 6 : at.top - box.height - 6}px`;
  const mine = noted;
  setTimeout(() => mine.remove(), kind === "bad" ? 9000 : 3000);
}

// A dialog covers the page but for its bar: Power off stays in reach, which a modal one would shut away.
let left = null; // the element that had the focus before
function opens(dialog, at = null) {
  noted?.remove(); // a refusal from before would be read as an answer to the question
  left ??= document.activeElement;
  document.querySelector("main.content").inert = true;
  if (!dialog.open) dialog.show();
  dialog.style.inset = dialog.style.margin = ""; // in the middle, or beside the button that asks
  const box = at?.getClientRects()[0];
  if (!box) return;
  const { width, height } = dialog.getBoundingClientRect();
  const strip = document.querySelector(".strip").getBoundingClientRect().bottom;
  const low = (document.querySelector(".timeline")?.getBoundingClientRect().top ?? innerHeight) - height - 6;
  const top = Math.max(strip + 6, Math.min(low, box.bottom + 6 < low ? box.bottom + 6 : box.top - height - 6));
  dialog.style.margin = 0;
  dialog.style.inset = `${top}px auto auto ${Math.max(8, Math.min(innerWidth - width - 8, box.left))}px`;
}
document.addEventListener("close", () => {
  const isOpen = document.querySelector("dialog[open]") !== null;
  document.querySelector("main.content").inert = isOpen;
  if (isOpen) return;
  left?.focus();
  left = null;
}, true);

// Tab stays within the dialog and Power off.
document.addEventListener("keydown", (event) => {
  const dialog = document.querySelector("dialog[open]");
  if (event.key !== "Tab" || !dialog) return;
  event.preventDefault();
  const round = [...dialog.querySelectorAll("input, button"), document.getElementById("stop"), document.getElementById("power-off")];
  const next = round.indexOf(document.activeElement) + (event.shiftKey ? -1 : 1);
  round.at(next % round.length).focus();
});

// One question at a time: a new one answers the one before with no.
let pending = null;
export function confirmed(text, at) {
  pending?.(false);
  const dialog = document.getElementById("confirm");
  document.getElementById("confirm-text").textContent = text;
  dialog.returnValue = "";
  opens(dialog, at);
  return new Promise((resolve) => (pending = resolve));
}
document.addEventListener("close", ({ target }) => {
  if (target.id !== "confirm" || target.open) return; // open: the end of the question before
  pending?.(target.returnValue === "yes");
  pending = null;
}, true);

const GOOD = ["done", "accepted"];

let stops = 0; // how often something that stops was pressed: that ends every sequence of steps

export const pressed = () => [tick, stops]; // when something is pressed: what comes after it, also while a question is open, ends it

export async function perform(button, steps, [since, before] = pressed()) {
  button.dataset.outcome = "waiting";
  for (const step of steps) {
    if (stops !== before) {
      button.dataset.outcome = "ended";
      note(button, "bad", "ended: something that stops was pressed meanwhile");
      return false;
    }
    const results = await Promise.all(step.map(([to, command, values, text]) => call(to, command, values, text, undefined, since)));
    const wrong = results.map(([outcome, reason], i) => [outcome, reason, step[i][0]]).filter(([outcome]) => !GOOD.includes(outcome));
    if (wrong.length) {
      button.dataset.outcome = wrong[0][0];
      const words = wrong.map(([outcome, reason, to]) => `${reason.startsWith(to) ? "" : `${to}: `}${outcome}: ${reason}`).join("\n");
      note(button, "bad", words);
      return false;
    }
  }
  button.dataset.outcome = "done";
  note(button, "good", "done");
  return true;
}

export async function asked(button, steps, free) {
  let when, text;
  do {
    if (!free && denied(button)) return false;
    [when, text] = [pressed(), button.dataset.confirm];
    if (text && !(await confirmed(text, button))) return false;
  } while (text !== button.dataset.confirm); // the state has changed while it was open: a yes is to what was asked
  if (!free && denied(button)) return false;
  return perform(button, button.dataset.steps ? JSON.parse(button.dataset.steps) : steps, when); // those of the words that were shown
}

async function reloads() {
  if (!kept() || await confirmed(`The console has new pages. Loading one drops: ${kept()}. Continue?`)) location.reload();
}

async function control(button) {
  lost = "";
  if (you) isGiven = say({ op: "control", take: false }) !== false;
  else if (isOutdated) note(button, "bad", "This page is outdated: load the new one first.");
  else if (person() || (await named(button))) {
    const from = holder; // the one in the question: from another one, the server refuses
    if (from && !(await confirmed(`${from} has control. Take it over?`, button))) return;
    const [outcome, text] = await ask({ op: "control", take: true, over: Boolean(from), from, person: person() });
    if (outcome === "refused") note(button, "bad", text);
  }
}

// The name of the person at this browser, which other pages show: asked once, kept in the browser.
const person = () => localStorage.getItem("person") || "";
function named(at) {
  const dialog = document.getElementById("person");
  const input = document.getElementById("person-name");
  input.value = person();
  dialog.returnValue = "";
  opens(dialog, at);
  input.focus();
  return new Promise((resolve) => dialog.addEventListener("close", () => {
    if (dialog.returnValue === "yes") localStorage.setItem("person", input.value.trim().slice(0, input.maxLength));
    resolve(dialog.returnValue === "yes" && person());
  }, { once: true }));
}

document.addEventListener("click", (event) => {
  const button = event.target.closest("button");
  if (!button) return;
  if (button.id === "control") control(button);
  else if (button.id === "control-lost") (lost = ""), shown();
  else if (button.id === "reload") reloads();
  else if (button.dataset.steps) {
    if (button.dataset.free !== undefined) stops += 1;
    asked(button, JSON.parse(button.dataset.steps), button.dataset.free !== undefined);
  } else if (button.dataset.view) document.querySelector(".stage").stage.look(button.dataset.view);
  else if (button.dataset.does === "close") button.closest("dialog").close("");
  else if (button.dataset.does === "person") document.querySelector("dialog[open]")?.close(""), named();
  else if (button.dataset.opens) opens(document.getElementById(button.dataset.opens));
  else if (button.dataset.does === "dismiss") {
    localStorage.setItem("first-steps", "closed");
    document.getElementById("first-steps").remove();
  } else if (button.dataset.does === "units") turnUnits();
  else if (button.dataset.does === "theme") theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
});

// A button that works while it is held works with the space bar, too: its first press counts, not its repetitions. Its release
// may be lost: it ends as well when repetitions end, and with any other key.
const SILENT_MS = 500;
export function heldByKey(css, begins, ends = jogEnds) {
  let repeated = 0; // when the newest repetition came; 0: none yet
  let isHeld = false;
  const release = () => {
    if (isHeld) ends();
    isHeld = false;
    repeated = 0;
  };
  document.addEventListener("keydown", (event) => {
    const button = event.key === " " && event.target.closest?.(css);
    if (!button) return release();
    event.preventDefault();
    if (event.repeat) {
      if (isHeld) repeated = performance.now();
      return;
    }
    release();
    isHeld = true;
    begins(button);
  }, true);
  document.addEventListener("keyup", release, true);
  setInterval(() => repeated && performance.now() - repeated > SILENT_MS && release(), 100);
}

// A held jog: sent every 50 ms while pressed; the arm ends it by itself 0.1 s after the last message.
let jog = null; // { button, timer, isOver }
function jogEnds() {
  if (!jog) return;
  clearInterval(jog.timer);
  jog.button.classList.remove("on");
  jog = null;
}
export function jogBegins(button, make) {
  jogEnds();
  if (denied(button)) return;
  const mine = { button, isOver: false };
  // Each has its answer: a refusal, for example by a fault, is shown at the button, and ends the jog.
  const heardOf = (outcome, text) => {
    if (GOOD.includes(outcome) || mine.isOver) return;
    mine.isOver = true;
    if (jog === mine) jogEnds();
    note(button, "bad", `${outcome}: ${text}`);
  };
  const push = () => {
    const found = make();
    if (!found || !hasControl() || document.hidden) jogEnds();
    else if (!isConnected()) heardOf("lost", "not connected");
    else ask(found, heardOf);
  };
  jog = mine;
  button.classList.add("on");
  mine.timer = setInterval(push, 50);
  push();
}
for (const name of ["pointerup", "pointercancel", "keyup", "visibilitychange"]) window.addEventListener(name, jogEnds, true);
window.addEventListener("blur", jogEnds); // of the window
window.addEventListener("focusout", (event) => event.target === jog?.button && jogEnds()); // a press takes the focus from another element
document.addEventListener("visibilitychange", () => (jogEnds(), want()));

// A person who changes pages was present until now: report that, as timeouts without a page in control count from it.
window.addEventListener("pagehide", () => you && say({ op: "beat" }));
window.addEventListener("pagehide", () => you && sessionStorage.setItem("control", String(Date.now())));

// --- keys, theme

const KEYS = { o: "power-off", s: "stop", p: "power-on", h: "home", t: "start-teleop" };
document.addEventListener("keydown", (event) => {
  const key = event.key.toLowerCase();
  if ((event.ctrlKey !== event.altKey) && (event.ctrlKey || key === "t") && KEYS[key]) {
    event.preventDefault();
    if (!event.repeat) document.getElementById(KEYS[key])?.click();
  } else if (event.key === "?" && !/INPUT|TEXTAREA|SELECT/.test(document.activeElement?.tagName || ""))
    opens(document.getElementById("help"));
  else if (event.key === "Escape") document.querySelector("dialog[open]")?.close("");
});

function theme(name) {
  localStorage.setItem("theme", name);
  document.documentElement.dataset.theme = name;
  document.documentElement.style.colorScheme = name;
}

// --- messages: a list, rebuilt when it changes

export const cell = (tag, text, className = "") => Object.assign(document.createElement(tag), { textContent: text, className });

let listed = "";
function messages() {
  const list = document.getElementById("messages");
  const rows = data("messages")?.rows;
  if (!list || !rows) return;
  const least = document.getElementById("severity")?.value || "status";
  const from = document.getElementById("from")?.value || "";
  const levels = ["status", "warning", "error"];
  const chosen = rows.filter((row) => levels.indexOf(row.severity) >= levels.indexOf(least) && (!from || row.from === from));
  const key = `${least} ${from} ${chosen.length} ${chosen[0]?.order} ${chosen.at(-1)?.order}`;
  if (key === listed && list.childElementCount) return;
  listed = key;
  const atEnd = list.scrollTop + list.clientHeight >= list.scrollHeight - 20;
  list.replaceChildren(
    ...(chosen.length ? chosen : [null]).map((row) => {
      const line = cell("div", "", `message ${row?.severity || ""}`);
      if (!row) line.append(cell("span", "No messages."));
      else {
        line.append(cell("time", new Date(row.at_ms).toLocaleTimeString("en-GB")), cell("b", row.from), cell("span", row.text));
        if (row.hint) line.append(cell("em", row.hint));
      }
      return line;
    }),
  );
  if (atEnd) list.scrollTop = list.scrollHeight;
}

// The remedy of an arm in FAULT: the hint of its last error.
function remedies() {
  const found = data("messages")?.remedies || {};
  for (const element of document.querySelectorAll("[data-remedy]")) put(element, found[element.dataset.remedy] || "");
}

onUnits(render);
onTick(messages);
onTick(remedies);
document.addEventListener("change", messages);

export function start() {
  theme(localStorage.getItem("theme") || (matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark"));
  for (const name of ["stop", "power-off"]) document.getElementById(name).disabled = false;
  connect();
  setInterval(() => say({ op: "beat" }), 500);
  setInterval(() => (want(), shown()), 250);
}
window.trocar = { value, data, present, rewind, hasControl, call, say, isConnected, onTick, note };
start();
