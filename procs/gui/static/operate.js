// The page Operate: panels beside the robot in 3D, joints within their limits, links, walls, and a jog by big buttons.
import { data, fixed, heldByKey, isPast, jogBegins, onTick, present, want } from "./live.js";
import { onUnits, perUnit, unit, units } from "./units.js";

const at = (id) => document.getElementById(id);
const put = (element, text) => element.textContent !== text && (element.textContent = text);
const SPEED = { slides: 0.006, turns: 0.1 }; // m/s, rad/s
const NEAR = 0.03; // fraction of the range, as in 3D

// --- panels: kept in the browser, shared by the address

const panels = [...document.querySelectorAll("[data-panel]")];
const presets = [...document.querySelectorAll("[data-preset]")];
const isThere = (name) => panels.some((panel) => panel.dataset.panel === name);
const wanted = (text) => text.split(/[ ,]/).filter(isThere);

function open(names) {
  for (const panel of panels) panel.hidden = !names.includes(panel.dataset.panel);
  for (const button of document.querySelectorAll("[data-opens-panel]")) {
    button.hidden = !isThere(button.dataset.opensPanel);
    button.setAttribute("aria-pressed", String(names.includes(button.dataset.opensPanel)));
  }
  for (const button of presets) button.setAttribute("aria-pressed", String(wanted(button.dataset.preset).sort().join() === [...names].sort().join()));
  localStorage.setItem("panels", names.join());
  history.replaceState(null, "", `#${names.join()}`);
  want();
  show();
}

document.addEventListener("click", ({ target }) => {
  const { preset, opensPanel } = target.closest("button")?.dataset ?? {};
  if (preset) open(wanted(preset));
  if (!opensPanel) return;
  const opened = panels.filter((panel) => !panel.hidden).map((panel) => panel.dataset.panel);
  open(opened.includes(opensPanel) ? opened.filter((name) => name !== opensPanel) : [...opened, opensPanel]);
});

// --- joints: a bar from limit to limit

const shown = (v, slides) => (typeof v === "number" ? `${fixed(v * perUnit(slides), units() === "deg" ? 1 : 3)} ${unit(slides)}` : "–");

function bar(arm, i) {
  const row = document.createElement("div");
  row.className = "limit";
  row.innerHTML = '<span class="joint"></span><div class="track" role="meter"><i class="goal">◆</i><i class="setpoint"></i><i class="measured"></i></div><span class="figure"></span>';
  row.dataset.joint = `${arm} ${i}`;
  return row;
}

const NOT_RECORDED = "Not recorded: return to live.";

function joints() {
  const root = at("limits");
  if (isPast()) return lines(root, [], NOT_RECORDED);
  root.querySelector(".link")?.remove();
  for (const [name, arm] of Object.entries(present("limits")?.arms ?? {})) {
    let box = root.querySelector(`[data-of="${name}"]`);
    if (!box) {
      box = Object.assign(document.createElement("div"), { className: "of" });
      box.dataset.of = name;
      box.append(Object.assign(document.createElement("h3"), { textContent: name }));
      root.append(box);
    }
    while (box.childElementCount - 1 < arm.names.length) box.append(bar(name, box.childElementCount - 1));
    while (box.childElementCount - 1 > arm.names.length) box.lastChild.remove();
    box.classList.toggle("stale", Boolean(arm.late));
    const isKnown = arm.valid && !arm.late;
    arm.names.forEach((joint, i) => place(box.children[i + 1], name, arm, i, joint, isKnown));
  }
}

function place(row, name, arm, i, joint, isKnown) {
  const [label, track, figure] = row.children;
  const [goal, setpoint, measured] = track.children;
  const [low, high] = [arm.lower[i], arm.upper[i]];
  const share = (v) => Math.min(1, Math.max(0, (v - low) / (high - low)));
  put(label, joint.replaceAll("_", " "));
  put(figure, shown(isKnown ? arm.q[i] : null, arm.slides[i]));
  for (const [mark, v] of [[goal, arm.goal[i]], [setpoint, arm.setpoint[i]], [measured, arm.q[i]]]) {
    mark.hidden = !isKnown || typeof v !== "number";
    if (!mark.hidden) mark.style.left = `${(100 * share(v)).toFixed(1)}%`;
  }
  const s = share(arm.q[i]);
  row.classList.toggle("near", isKnown && (s < NEAR || s > 1 - NEAR));
  const text = `${shown(isKnown ? arm.q[i] : null, arm.slides[i])}, from ${shown(low, arm.slides[i])} to ${shown(high, arm.slides[i])}`;
  if (track.title === text) return;
  track.title = text;
  track.setAttribute("aria-label", `${name} ${joint}`);
  track.setAttribute("aria-valuetext", text);
  for (const [key, v] of [["min", low], ["max", high], ["now", isKnown ? arm.q[i] : low]]) track.setAttribute(`aria-value${key}`, String(v));
}

// --- links, walls: lines of text

function lines(root, rows, none) {
  while (root.childElementCount < Math.max(1, rows.length)) root.append(document.createElement("div"));
  while (root.childElementCount > Math.max(1, rows.length)) root.lastChild.remove();
  (rows.length ? rows : [{ text: none, tone: "none", why: "" }]).forEach(({ text, tone, why }, i) => {
    const row = root.children[i];
    row.className = `link ${tone}`;
    if (!row.childElementCount) row.append(document.createElement("b"), document.createElement("span"));
    put(row.children[0], text);
    put(row.children[1], why);
  });
}

function links() {
  if (isPast()) return lines(at("links"), [], NOT_RECORDED);
  const found = (present("strip")?.links ?? []).map((link) => {
    const masters = link.masters.filter(Boolean).join(" + ");
    const isOn = link.following && !link.late;
    const state = link.late ? "no data" : isOn ? "follows" : link.state.toLowerCase().replaceAll("_", " ");
    return { text: `${isOn ? "⇄" : "·"} ${masters} → ${link.slave}`, tone: isOn ? "good" : link.reason && link.state !== "DISABLED" ? "warn" : "", why: isOn || !link.reason ? state : `${state}: ${link.reason}` };
  });
  lines(at("links"), found, "No teleoperation.");
}

function walls() {
  const found = Object.entries(data("scene")?.walls ?? {}).flatMap(([arm, { walls: all = [], at: stops }]) => all.map((wall) => {
    const isStop = stops && stops.split(" ")[0] === wall.name;
    const why = wall.near === null ? "off" : isStop ? "keeps the arm from its goal" : wall.near > 0 ? `near: ${Math.round(100 * wall.near)} %` : "away";
    return { text: `${isStop ? "▲ " : ""}${arm}: ${wall.name}`, tone: isStop || wall.near > 0 ? "warn" : "", why: `${wall.shape}, ${why}` };
  }));
  lines(at("walls"), found, "No walls.");
}

// --- jog by big buttons, of one joint

const chosen = () => [at("jog-arm").value, Number(at("jog-joint").value)];
function jogged() {
  const arm = present("limits")?.arms?.[at("jog-arm").value];
  const select = at("jog-joint");
  const names = arm?.names ?? [];
  if ([...select.options].map((option) => option.text).join() !== names.map((name) => name.replaceAll("_", " ")).join())
    select.replaceChildren(...names.map((name, i) => new Option(name.replaceAll("_", " "), i)));
  const i = Number(select.value);
  put(at("jog-now"), !isPast() && arm?.valid && !arm.late ? shown(arm.q[i], arm.slides[i]) : "–");
}

function jog(button) {
  const [name, i] = chosen();
  jogBegins(button, () => {
    const arm = present("limits")?.arms?.[name];
    if (!arm || i >= arm.names.length) return null;
    const values = arm.names.map(() => 0);
    values[i] = Number(button.dataset.big) * (arm.slides[i] ? SPEED.slides : SPEED.turns);
    return { op: "call", to: name, command: "servo_jv", values };
  });
}
document.addEventListener("pointerdown", (event) => {
  const button = event.target.closest("button[data-big]");
  if (!button || event.button) return;
  event.preventDefault();
  jog(button);
});
document.addEventListener("contextmenu", (event) => event.target.closest("button[data-big]") && event.preventDefault());
heldByKey("button[data-big]", jog);

function show() {
  const isOpen = (name) => panels.some((panel) => panel.dataset.panel === name && !panel.hidden);
  if (isOpen("joints")) joints();
  if (isOpen("links")) links();
  if (isOpen("walls")) walls();
  if (isOpen("jog")) jogged();
}

open(wanted(decodeURIComponent(location.hash.slice(1)) || localStorage.getItem("panels") || presets[0].dataset.preset));
onTick(show);
onUnits(show);
setInterval(show, 250); // also while no tick comes
