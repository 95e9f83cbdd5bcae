// The page of an arm: jog while held, goals as people type them, a preview in 3D before anything moves.
import { ask, asked, denied, fixed, heldByKey, isPast, jogBegins, note, onTick, sourceAge, value } from "./live.js";
import { inUnits, onUnits, perUnit, typed, unit, units } from "./units.js";

const page = document.querySelector("[data-arm]");
export const arm = page.dataset.arm;
export const state = `${arm}/state`;
const slides = (i) => page.dataset.slides.split("")[i] === "1";
const count = () => value(`${state}.count`) || 0;
const measured = () => (value(`${state}.position`) || []).slice(0, count());
const goals = () => [...page.querySelectorAll("input[data-goal]")].slice(0, count());
const factor = (i) => perUnit(slides(i));
const speed = () => Number(document.getElementById("jog-speed").value) / 100;
const FULL = { slides: 0.03, turns: 0.5 }; // m/s, rad/s of a jog at 100 %

const shownSpeed = () => {
  document.getElementById("jog-shown").textContent = units() === "deg" ? `${(speed() * FULL.turns * 57.2958).toFixed(1)} °/s, ${(speed() * FULL.slides * 1000).toFixed(1)} mm/s` : `${(speed() * FULL.turns).toFixed(2)} rad/s, ${(speed() * FULL.slides).toFixed(3)} m/s`;
};

// Whether the value behind a flag of the record is measured now; if not, a note appears beside the button.
export function isMeasured(flag, button) {
  if (isPast()) return button && denied(button), false; // a past place is no goal of now
  const age = sourceAge(state);
  if (age !== null && age < 1 && value(`${state}.${flag}`)) return true;
  if (button) note(button, "bad", `Nothing is measured now: ${arm} has no power, sends no data, or does not know this value.`);
  return false;
}

function read(button) {
  if (!isMeasured("valid", button)) return;
  measured().forEach((q, i) => {
    const input = goals()[i];
    input.value = fixed(q * factor(i), units() === "deg" ? 2 : 4);
    input.classList.remove("wrong");
  });
  preview();
}

function readJaw(button) {
  const angle = value(`${state}.jaw_position`);
  if (isMeasured("has_jaw", button)) document.getElementById("jaw-goal").value = fixed(angle * perUnit(false), units() === "deg" ? 2 : 4);
}

// The goal in rad and m; null where something is no number.
function goal() {
  let isRight = true;
  const found = goals().map((input, i) => {
    const number = typed(input.value);
    input.classList.toggle("wrong", number === null);
    isRight &&= number !== null;
    return number === null ? 0 : number / factor(i);
  });
  return isRight && found.length ? found : null;
}

// The joints that would move, from and to, as the page shows them.
function moves() {
  const digits = units() === "deg" ? 2 : 4;
  const shown = (q, i) => (typeof q === "number" ? fixed(q * factor(i), digits) : "–");
  const words = goal().map((q, i) => [shown(measured()[i], i), shown(q, i), i]).filter(([from, to]) => from !== to);
  return words.map(([from, to, i]) => `${value(`${state}.names`)[i]} ${from} → ${to} ${unit(slides(i))}`).join(", ") || "it is there already";
}

export const stage = () => document.querySelector(".stage")?.stage;

// The arm's preview as a green shape; null, with a note, if the pose is out of reach, or another one was asked meanwhile.
let newest = 0;
export async function previewed(wanted, says) {
  const mine = ++newest;
  const [outcome, answer] = await ask({ op: "preview", arm, ...wanted });
  if (mine !== newest) return null;
  const found = outcome === "done" ? JSON.parse(answer) : null;
  says.textContent = found ? "" : inUnits(answer);
  stage()?.preview(found?.frames, value(`${state}.jaw_position`));
  return found;
}

let lasts = ""; // duration of the previewed move, in words
async function preview() {
  const wanted = goal();
  if (!wanted) {
    newest += 1; // a late answer does not make what is typed now look right
    stage()?.preview(null);
    return false;
  }
  const says = document.getElementById("preview-says");
  const found = await previewed({ position: wanted }, says);
  if (!found) return false;
  found.beyond.forEach((beyond, i) => goals()[i]?.classList.toggle("wrong", beyond));
  const isBeyond = found.beyond.some(Boolean);
  lasts = found.seconds === null ? "" : `, ${found.seconds.toFixed(1)} s`;
  if (isBeyond) says.textContent = "Beyond the limits of a joint: red.";
  return !isBeyond;
}

page.addEventListener("input", (event) => {
  if (event.target.dataset.goal !== undefined) preview();
  if (event.target.id === "jog-speed") shownSpeed();
});
page.addEventListener("change", (event) => {
  if (event.target.id === "ratio") asked(event.target, [[[arm, "trajectory_j/set_ratio", [Number(event.target.value) / 100], ""]]]);
});

page.addEventListener("click", async (event) => {
  const button = event.target.closest("button");
  if (!button) return;
  if (button.dataset.does === "read") read(button);
  else if (button.dataset.does === "read-jaw") readJaw(button);
  else if (button.dataset.does === "move") {
    if (!(await preview())) return note(button, "bad", goal() ? document.getElementById("preview-says").textContent : "A number is missing or invalid.");
    button.dataset.confirm = `Move ${arm}: ${moves()}${lasts}? The green shape shows it.`;
    if (await asked(button, [[[arm, "move_jp", goal(), ""]]])) stage()?.preview(null);
  } else if (button.dataset.does === "jaw") {
    const angle = typed(document.getElementById("jaw-goal").value);
    if (angle === null) return note(button, "bad", "This is not a number.");
    button.dataset.confirm = `Move the jaw of ${arm} to ${angle} ${unit(false)}?`;
    asked(button, [[[arm, "jaw/move_jp", [angle / perUnit(false)], ""]]]);
  } else if (button.dataset.says) {
    const chosen = document.getElementById(button.dataset.with);
    asked(button, [[[arm, button.dataset.says, [], chosen.value]]]);
  }
});

function jogs(button) {
  const i = Number(button.dataset.joint);
  const sign = Number(button.dataset.sign);
  if (button.dataset.twist) {
    const isTurn = button.dataset.twist === "angular";
    const twist = new Array(6).fill(0);
    return jogBegins(button, () => {
      twist[Number(button.dataset.axis) + (isTurn ? 3 : 0)] = sign * speed() * (isTurn ? FULL.turns : FULL.slides);
      return { op: "jog", arm, twist, in_tip: document.getElementById("jog-axes").value === "tip" };
    });
  }
  jogBegins(button, () => {
    const n = count();
    if (i >= n) return null;
    const velocity = new Array(n).fill(0);
    velocity[i] = sign * speed() * (slides(i) ? FULL.slides : FULL.turns);
    return { op: "call", to: arm, command: "servo_jv", values: velocity };
  });
}
page.addEventListener("pointerdown", (event) => {
  const button = event.target.closest("button.jog");
  if (!button || event.button) return;
  event.preventDefault();
  jogs(button);
});
heldByKey("button.jog", jogs);
page.addEventListener("contextmenu", (event) => event.target.closest("button.jog") && event.preventDefault());

let isRead = false;
let ratioSet = false;
let isChosen = false;
onTick(() => {
  if (isPast()) return;
  if (!isRead && count() && isMeasured("valid")) {
    isRead = true;
    read();
    readJaw();
  }
  const tool = value(`${state}.tool`);
  const choice = document.getElementById("instrument") || document.getElementById("endoscope");
  if (!isChosen && tool && choice) {
    isChosen = true;
    if ([...choice.options].some((option) => option.value === tool)) choice.value = tool;
  }
  const ratio = value(`${state}.trajectory_ratio`);
  if (!ratioSet && typeof ratio === "number") {
    ratioSet = true;
    document.getElementById("ratio").value = Math.round(ratio * 100);
  }
});
onUnits(shownSpeed);
shownSpeed();
