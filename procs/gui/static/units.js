// Numbers as people see and type them: in degrees and mm, or in rad and m. What is typed keeps its meaning where that changes.
const stored = () => localStorage.getItem("units") || "deg";
let used = stored(); // by this page, until it has converted what is typed: other tabs change what is stored
const followers = [];

export const units = () => used;
export const unit = (slides) => (used === "deg" ? (slides ? "mm" : "°") : slides ? "m" : "rad");
// How many of the unit are one m, or one rad.
export const perUnit = (slides, of = used) => (of !== "deg" ? 1 : slides ? 1000 : 180 / Math.PI);
export const onUnits = (follower) => followers.push(follower);

// A number as people type it, with a comma or a point; null when it is none.
export function typed(text) {
  const found = Number(text.trim().replace(",", ".").replace("−", "-"));
  return text.trim() && Number.isFinite(found) ? found : null;
}

// Whether what is typed is a length. "joint": as what is chosen in its form moves.
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
