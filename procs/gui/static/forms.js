// Switches, which show whether something is on, and forms: inputs whose values go out with a command.
import { asked, call, confirmed, denied, hasControl, heldByKey, isPast, note, onTick, perform, pressed, send, value } from "./live.js";
import { perUnit, typed, unit, units } from "./units.js";

// The typed text as the number to send; null if it is not a number, or too large.
function number(input, slides) {
  const v = typed(input.value);
  const { low, high } = input.dataset;
  if (v === null || (low !== undefined && v < +low) || (high !== undefined && v > +high)) return null;
  let kind = input.dataset.arg;
  if (kind.startsWith("joint")) kind = units() !== "deg" ? "num" : slides || kind === "joint-p" ? "mm" : "deg";
  return kind === "deg" ? (v * Math.PI) / 180 : kind === "mm" ? v / 1000 : v;
}

function allowed(input) {
  const { low, high } = input.dataset;
  return low === undefined && high === undefined ? "a number" : `from ${low} to ${high}`;
}

const chosen = (form) => form.querySelector("select")?.selectedOptions[0]?.dataset.slides === "p";

// The values of a form; null, with a note beside the button, if one is invalid.
export function values(form, button) {
  const found = [];
  for (const input of form.querySelectorAll("[data-arg]")) {
    const v = input.dataset.arg === "choice" ? +input.value : number(input, chosen(form));
    input.classList.toggle("wrong", v === null);
    if (v === null) {
      note(button, "bad", `${input.getAttribute("aria-label") || "This"}: ${allowed(input)} is needed.`);
      return null;
    }
    found.push(v);
  }
  return found;
}

async function flip(button) {
  const on = value(button.dataset.switch);
  if (denied(button)) return;
  const question = on ? button.dataset.confirmOff : button.dataset.confirmOn;
  const when = pressed();
  if (question && !(await confirmed(question, button))) return;
  if (on !== value(button.dataset.switch)) return flip(button); // the question was about the other way
  if (!denied(button)) perform(button, JSON.parse(on ? button.dataset.stepsOff : button.dataset.stepsOn), when);
}

// The values at `data-now`, as they would be typed; unknown ones are left out.
function read(form, button) {
  if (isPast()) return void denied(button); // it would be taken for the present place
  const inputs = [...form.querySelectorAll("[data-now]")];
  if (inputs.some(({ dataset }) => dataset.valid && !value(dataset.valid))) return note(button, "bad", "Its position is not known now.");
  for (const input of inputs) {
    const v = value(input.dataset.now);
    const factor = perUnit(input.dataset.arg === "joint-p");
    if (typeof v === "number") input.value = (v * factor).toFixed(units() === "deg" ? 2 : 4);
    input.classList.remove("wrong");
  }
}

// A button that works while it is held. It ends with the pointer, the page, or control.
let held = null;
function letGo() {
  if (!held) return;
  clearInterval(held.timer);
  held.button.classList.remove("on");
  const [to, command, found] = JSON.parse(held.button.dataset.release);
  send(to, command, found);
  held = null;
}

function holdOn(button) {
  letGo();
  if (denied(button)) return;
  const [to, command, found] = JSON.parse(button.dataset.hold);
  const every = +button.dataset.every || 0;
  const again = () => (hasControl() ? send(to, command, found) : letGo());
  held = { button, timer: every ? setInterval(again, every) : 0 };
  button.classList.add("on");
  call(to, command, found, "", (outcome, reason) => {
    if (outcome === "done" || outcome === "accepted") return;
    letGo();
    note(button, "bad", `${outcome}: ${reason}`);
  });
}

// Only by the first button: the menu of another one would swallow that it is let go.
document.addEventListener("pointerdown", (event) => {
  const button = event.target.closest("button[data-hold]");
  if (button && !event.button) holdOn(button);
});
heldByKey("button[data-hold]", holdOn, letGo);
document.addEventListener("contextmenu", (event) => event.target.closest("button[data-hold]") && event.preventDefault());
for (const name of ["pointerup", "pointercancel", "keyup", "visibilitychange", "pagehide"]) window.addEventListener(name, letGo, true);
window.addEventListener("focusout", (event) => event.target === held?.button && letGo()); // a press takes the focus from another element
window.addEventListener("blur", letGo); // of the window, not of the previously focused element

document.addEventListener("click", (event) => {
  const button = event.target.closest("button");
  if (button?.dataset.switch) return flip(button);
  if (button?.dataset.reads !== undefined) return read(button.closest("[data-form]"), button);
  if (button?.dataset.submit === undefined) return;
  const form = button.closest("[data-form]");
  const [to, command, text] = JSON.parse(form.dataset.form);
  const found = values(form, button);
  const word = form.querySelector("[data-word]")?.value || "";
  if (found) asked(button, [[[to, command, found, [text, word].filter(Boolean).join(" ")]]], button.dataset.free !== undefined);
});

onTick(() => {
  for (const label of document.querySelectorAll(".unit.chosen")) {
    const text = unit(chosen(label.closest("[data-form]")));
    if (label.textContent !== text) label.textContent = text;
  }
});
