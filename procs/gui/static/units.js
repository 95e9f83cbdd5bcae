// Numbers as shown and typed: in degrees and mm, or in rad and m. A typed value is converted when the unit changes.
const stored = () => localStorage.getItem("units") || "deg";
let used = stored(); // by this page, until it has converted the typed values: other tabs change the stored unit
const followers = [];

export const units = () => used;
export const unit = (slides) => (used === "deg" ? (slides ? "mm" : "°") : slides ? "m" : "rad");
// How many of the unit are one m, or one rad.
export const perUnit = (slides, of = used) => (of !== "deg" ? 1 : slides ? 1000 : 180 / Math.PI);
export const onUnits = (follower) => followers.push(follower);

// A number as people type it, with a comma or a point; null when it is none, or could be read as another one: 1,000.
const NUMBER = /^[-+−]?(\d+([.,]\d*)?|[.,]\d+)(e[-+]?\d+)?$/i;
const GROUPED = /^[-+−]?[1-9]\d{0,2},\d{3}$/;
export function typed(text) {
  const found = text.trim();
  return NUMBER.test(found) && !GROUPED.test(found) ? Number(found.replace(",", ".").replace("−", "-")) : null;
}

// A sentence of a process, which speaks of m and rad, in the units of the page.
export const inUnits = (text) => used !== "deg" ? text : text.replace(/(-?\d+(?:\.\d+)?(?:e-?\d+)?) (m|rad)(?![\w/²])/g, (_, v, of) => `${+(v * perUnit(of === "m")).toPrecision(5)} ${unit(of === "m")}`);

// Whether the typed value is a length. "joint": by the type of the joint chosen in its form.
function isLength(input) {
  const kind = input.dataset.typed || input.dataset.arg.split("-")[1] || "joint";
  const chosen = kind === "joint" && input.closest("[data-form]")?.querySelector("select");
  return kind === "p" || chosen?.selectedOptions?.[0]?.dataset.slides === "p";
}

function use(name) {
  if (name === used) return;
  const before = used;
  used = name;
  for (const input of document.querySelectorAll("input[data-typed], input[data-arg^=joint]")) {
    const v = typed(input.value);
    const slides = isLength(input);
    if (v !== null) input.value = String(+((v / perUnit(slides, before)) * perUnit(slides)).toPrecision(7));
  }
  for (const follower of followers) follower();
}

export function turnUnits() {
  localStorage.setItem("units", used === "deg" ? "si" : "deg");
  use(stored());
}

window.addEventListener("storage", (event) => event.key === "units" && use(stored()));
window.addEventListener("pageshow", () => use(stored())); // the browser kept the page while another one was seen
