// Poses as typed: goals of the tip, with a preview before the motion; poses of the base.
import { arm, isMeasured, previewed, stage, state } from "./arm.js";
import { asked, fixed, isPast, note, onTick, value } from "./live.js";
import { quaternion, turns } from "./pose.js";
import { perUnit, typed, unit, units } from "./units.js";

const inputs = (pose) => [...document.querySelectorAll(`input[data-pose="${pose}"]`)];
const factor = (i) => perUnit(i < 3);

function read(pose, from) {
  const now = value(from);
  if (!inputs(pose).length || !now?.every((v) => typeof v === "number")) return; // setup joints give some bases
  [...now.slice(0, 3), ...turns(now.slice(3))].forEach((v, i) => {
    const input = inputs(pose)[i];
    input.value = fixed(v * factor(i), units() === "deg" ? 2 : 5);
    input.classList.remove("wrong");
  });
}

// x y z in m and a quaternion x y z w; null where something is no number.
function wanted(pose) {
  const found = inputs(pose).map((input, i) => {
    const v = typed(input.value);
    input.classList.toggle("wrong", v === null);
    return v === null ? null : v / factor(i);
  });
  return found.includes(null) ? null : [...found.slice(0, 3), ...quaternion(found.slice(3))];
}

// A pose in words, as it goes out.
function said(pose) {
  const parts = [...pose.slice(0, 3), ...turns(pose.slice(3))].map((v, i) => fixed(v * factor(i), units() === "deg" ? 2 : 5));
  return `x ${parts[0]}, y ${parts[1]}, z ${parts[2]} ${unit(true)}, turned about x ${parts[3]}, y ${parts[4]}, z ${parts[5]} ${unit(false)}`;
}

const says = () => document.getElementById("tip-says");
const preview = (pose) => previewed({ pose }, says());
const NO_NUMBER = "A number is missing or invalid.";

document.addEventListener("input", (event) => {
  const pose = event.target.dataset?.pose && wanted(event.target.dataset.pose);
  if (pose && event.target.dataset.pose === "tip") preview(pose);
});

document.addEventListener("click", async (event) => {
  const button = event.target.closest("button");
  const does = button?.dataset.does;
  if (does === "read-tip") {
    if (!isMeasured("reference_valid", button)) return;
    read("tip", `${state}.measured_cp`);
    says().textContent = "";
    stage()?.preview(null);
  } else if (does === "read-base") isMeasured("reference_valid", button) && read("base", `${state}.base_frame`);
  else if (does === "move-tip") {
    const pose = wanted("tip");
    const found = pose && (await preview(pose));
    if (!found) return note(button, "bad", pose ? says().textContent : NO_NUMBER);
    button.dataset.confirm = `Move the tip of ${arm} to ${said(pose)}${found.seconds === null ? "" : `, ${found.seconds.toFixed(1)} s`}? The green shape shows it. The joints move straight; the tip may not.`;
    if (await asked(button, [[[arm, "move_cp", pose, ""]]])) stage()?.preview(null);
  } else if (does === "set-base") {
    const pose = wanted("base");
    const frame = document.getElementById("base-in");
    frame.classList.toggle("wrong", !frame.checkValidity());
    if (!pose || !frame.checkValidity()) return note(button, "bad", pose ? "A name has letters, digits and signs, no blanks." : NO_NUMBER);
    const place = frame.value || value(`${state}.reference_frame`);
    button.dataset.confirm = `Set the base frame of ${arm} to ${said(pose)}${place ? `, in ${place}` : ""}? All its poses change; teleoperations that use them stop.`;
    asked(button, [[[arm, "set_base_frame", pose, frame.value]]]);
  }
});

let isRead = false;
onTick(() => {
  if (isRead || isPast() || !isMeasured("reference_valid") || !inputs("tip").length) return;
  isRead = true;
  read("tip", `${state}.measured_cp`);
  read("base", `${state}.base_frame`);
});
