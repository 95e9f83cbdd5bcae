// The strip of every page: arms in a word each, alarms, the clock, the next step, and what Stop stops.
import { cell, isConnected, onTick, present } from "./live.js";

const at = (id) => document.getElementById(id);
const put = (element, text) => element.textContent !== text && (element.textContent = text);
const ICONS = { off: "○", powering: "◔", powered: "◐", homing: "◑", ready: "●", moving: "▶", follows: "⇄", paused: "‖", fault: "▲", "no data": "?" };
const SAID = ["off", "powered", "ready", "paused", "no data"]; // changes that are read out; a fault is an alarm

// --- arms

// The arm's word; while a teleoperation moves it, that it follows.
function wordOf(name, found) {
  const word = found?.arms[name]?.word ?? "no data";
  const follows = ["ready", "moving"].includes(word) && found.links.some((link) => link.following && !link.late && [link.slave, ...link.masters].includes(name));
  return follows ? "follows" : word;
}

function chips(found) {
  for (const chip of document.querySelectorAll("[data-arm-chip]")) {
    const name = chip.dataset.armChip;
    const word = wordOf(name, found);
    const reason = found?.arms[name]?.reason || "";
    if (chip.title !== reason) chip.title = reason;
    if (chip.dataset.word === word) continue;
    chip.dataset.word = word;
    put(chip.querySelector(".icon"), ICONS[word]);
    put(chip.querySelector(".word"), word);
    if (SAID.includes(word) && found) put(at("announced"), `${name} ${word}`);
  }
}

function clock(found) {
  const text = !found ? "–" : found.clock === "wall" ? "real time" : `simulated ×${found.speed.toFixed(2)}`;
  put(at("clock"), text);
  at("clock").title = found?.clock === "wall" ? "The clock of the system is the real one" : "Simulated time, and its speed: boards are emulated, or arms have no robot";
}

// --- the next step

const TASKS = { power_on: "Powering on …", home: "Homing …" };
const steps = [...document.querySelectorAll("[data-step]")];
const listed = (names) => (names.length > 4 ? `${names.slice(0, 3).join(", ")} and ${names.length - 3} more` : names.join(", "));

// The step that the state calls for, and its text where it is no button.
function nextStep(found) {
  if (!found) return ["none", "–"];
  if (TASKS[found.task]) return ["none", TASKS[found.task]];
  const words = Object.values(found.arms).map((arm) => arm.word);
  const isOn = (word) => !["off", "powering", "fault", "no data"].includes(word);
  if (words.includes("fault") || !words.some(isOn)) return ["power-on", ""];
  if (words.includes("paused")) return ["resume", ""];
  if (words.includes("powered") || words.includes("homing")) return ["home", ""];
  const teleop = at("start-teleop");
  if (teleop && !found.consoles[teleop.dataset.console]) return ["teleop", ""];
  return ["none", "Ready"];
}

function next(found) {
  const [which, text] = nextStep(found);
  const had = steps.some((step) => step === document.activeElement);
  for (const step of steps) step.hidden = step.dataset.step !== which;
  put(steps.find((step) => step.dataset.step === "none"), text || "–");
  if (had && document.activeElement?.hidden) steps.find((step) => !step.hidden && step.tagName === "BUTTON")?.focus();
  if (found) questions(found.arms);
}

// Questions name the arms, as they are now.
function questions(arms) {
  const names = (...words) => Object.keys(arms).filter((name) => words.includes(arms[name].word));
  const count = Object.keys(arms).length;
  const faults = names("fault").map((name) => `${name} is in FAULT: ${arms[name].reason}`);
  const on = names("off", "powering", "fault", "no data");
  const off = names("off", "powering", "fault", "no data", "powered", "homing", "paused");
  const paused = names("paused");
  const texts = {
    resume: `Resume ${listed(paused)} (${paused.length} of ${count})? They resume what they were doing, and may move.`,
    "power-on": [...faults, `Power on ${listed(on) || "all arms"} (${on.length} of ${count})? Amplifiers switch on.`].join("\n"),
    home: [...faults, `Home ${listed(off) || "all arms"} (${off.length} of ${count})? They move. Keep hands and tissue away.`].join("\n"),
  };
  const steps = JSON.stringify([paused.map((name) => [name, "state_command", [], "resume"])]);
  if (at("resume").dataset.steps !== steps) at("resume").dataset.steps = steps; // of the arms in its question
  for (const button of document.querySelectorAll("[data-asks]")) if (button.dataset.confirm !== texts[button.dataset.asks]) button.dataset.confirm = texts[button.dataset.asks];
}

// --- alarms: errors of all processes, until a person at this browser acknowledges them

const KEPT = 400;
const idOf = (row) => JSON.stringify([row.from, row.at_ms, row.order, row.code, row.component, row.text]);
const acknowledged = () => new Set(JSON.parse(localStorage.getItem("acknowledged") || "[]"));
function acknowledge(rows) {
  localStorage.setItem("acknowledged", JSON.stringify([...acknowledged(), ...rows.map(idOf)].slice(-KEPT)));
  alarms();
}

let drawn = "";
let known = null; // ids of the alarms that were there before
function alarms() {
  const rows = present("alarms")?.rows;
  if (!isConnected()) put(at("alarms"), "? alarms");
  if (!rows || !isConnected()) return void (drawn = "");
  const [first, last] = [rows[0], rows.at(-1)];
  const key = `${rows.length} ${first && idOf(first)} ${last && idOf(last)} ${localStorage.getItem("acknowledged")}`;
  if (key === drawn) return;
  drawn = key;
  const done = acknowledged();
  const open = rows.filter((row) => !done.has(idOf(row)));
  const button = at("alarms");
  put(button, open.length === 1 ? "▲ 1 alarm" : `${open.length ? "▲" : "✓"} ${open.length} alarms`);
  button.classList.toggle("on", open.length > 0);
  at("alarm-list").querySelector("[data-acknowledge]").disabled = !open.length;
  const list = [...rows].reverse();
  at("alarm-rows").replaceChildren(...list.map((row) => line(row, done.has(idOf(row)))), ...(rows.length ? [] : [cell("p", "No alarms.", "quiet")]));
  const fresh = known && open.filter((row) => !known.has(idOf(row)));
  known = new Set(rows.map(idOf));
  if (fresh?.length) {
    put(at("alarmed"), `${fresh.at(-1).from}: ${fresh.at(-1).text}`);
    sounds();
  }
}

function line(row, isDone) {
  const found = cell("div", "", `message ${isDone ? "done" : "error"}`);
  found.append(cell("time", new Date(row.at_ms).toLocaleTimeString("en-GB")), cell("b", row.from), cell("span", row.text));
  if (row.hint) found.append(cell("em", row.hint));
  if (!isDone) {
    const button = Object.assign(cell("button", "Acknowledge"), { type: "button" });
    button.setAttribute("aria-label", `Acknowledge: ${row.from}, ${row.text}`);
    button.addEventListener("click", () => (acknowledge([row]), at("alarms").focus()));
    found.append(button);
  } else found.append(cell("small", "acknowledged"));
  return found;
}

// A sound at each new alarm; browsers play one only after a person has pressed something on the page.
let audio = null;
const isSounding = () => localStorage.getItem("sound") === "on";
function sounds() {
  if (!isSounding()) return;
  audio ??= new AudioContext();
  audio.resume();
  for (const begin of [0, 0.25]) {
    const [tone, volume] = [audio.createOscillator(), audio.createGain()];
    tone.frequency.value = 880;
    volume.gain.value = 0.2;
    tone.connect(volume).connect(audio.destination);
    tone.start(audio.currentTime + begin);
    tone.stop(audio.currentTime + begin + 0.15);
  }
  at("sound").dataset.played = String(Number(at("sound").dataset.played || 0) + 1);
}
function sound() {
  put(at("sound"), isSounding() ? "Sound is on" : "Sound is off");
  at("sound").setAttribute("aria-pressed", String(isSounding()));
}

function list(isOpen) {
  at("alarm-list").hidden = !isOpen;
  at("alarms").setAttribute("aria-expanded", String(isOpen));
}

document.addEventListener("click", (event) => {
  const button = event.target.closest("button");
  if (button?.id === "alarms") list(at("alarm-list").hidden);
  else if (button?.id === "sound") {
    localStorage.setItem("sound", isSounding() ? "off" : "on");
    sound();
    sounds();
  } else if (button?.dataset.acknowledge !== undefined) acknowledge(present("alarms")?.rows ?? []);
  else if (!event.target.closest("#alarm-list") && event.target.isConnected) list(false);
});
document.addEventListener("keydown", (event) => {
  if (event.key !== "Escape" || at("alarm-list").hidden) return;
  list(false);
  at("alarms").focus();
});
window.addEventListener("storage", alarms); // acknowledged in another tab

function strip() {
  const found = isConnected() ? present("strip") : null;
  chips(found);
  clock(found);
  next(found);
  alarms();
}

sound();
strip();
onTick(strip);
setInterval(strip, 250);
