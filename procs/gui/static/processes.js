// The page Processes: a row for each, and the log of the one that is chosen.
import { cell, data, isPast, onTick } from "./live.js";

const shownOr = (v, digits) => (typeof v === "number" && v > 0 ? v.toFixed(digits) : "–");
let chosen = location.hash.slice(1);

// The cells of a row after its name.
const texts = (row) => [
  row.kind, row.state.toLowerCase(), shownOr(row.rate_hz, 0), shownOr(row.period_p99_ms, 2), shownOr(row.work_p99_ms, 2), String(row.missed),
  row.cpu === null ? "–" : row.cpu.toFixed(0), shownOr(row.memory_mb, 0), String(row.restarts ?? 0), row.error || row.exit_reason || row.policy || "",
];

function made(row) {
  const found = document.createElement("tr");
  found.dataset.name = row.name;
  const name = cell("td", "");
  name.append(Object.assign(cell("button", row.name, "link"), { type: "button", title: "Show its log" }));
  found.append(name, ...texts(row).map((text) => cell("td", text)));
  return found;
}

// The existing row is changed, not rebuilt: it may have the keyboard's focus.
function line(body, row) {
  let found = body.querySelector(`[data-name="${CSS.escape(row.name)}"]`);
  if (!found) body.append((found = made(row)));
  found.className = row.state === "RUNNING" ? (row.error ? "bad" : "") : row.state === "STOPPED" ? "quiet" : "bad";
  found.classList.toggle("here", row.name === chosen);
  texts(row).forEach((text, i) => found.cells[i + 1].textContent !== text && (found.cells[i + 1].textContent = text));
}

let listed = "";
function processes() {
  const rows = data("processes")?.rows;
  const body = document.getElementById("processes");
  const key = rows && JSON.stringify(rows) + chosen;
  if (body && isPast()) body.replaceChildren(); // no recording has it
  if (!body || !rows || key === listed) return;
  listed = key;
  for (const row of rows) line(body, row);
}

const at = (id) => document.getElementById(id);
let written = null;
function log() {
  if (!at("log-card")) return;
  at("log-card").hidden = !chosen;
  if (!chosen) {
    delete at("log").dataset.wants; // it is hidden: nothing is read
    delete at("log-card").dataset.source;
    return;
  }
  const source = `log:${chosen}`;
  if (at("log").dataset.wants !== source) {
    at("log").dataset.wants = at("log-card").dataset.source = source;
    at("log-of").textContent = `Log of ${chosen}`;
    written = null;
  }
  const found = data(source);
  if (!found || found === written) return;
  written = found;
  const list = at("log");
  const atEnd = !list.childElementCount || list.scrollTop + list.clientHeight >= list.scrollHeight - 20;
  const rows = found.rows || [["", "ERROR", found.problem || "It cannot be read."]];
  list.replaceChildren(
    ...rows.map(([when, level, text]) => {
      const row = cell("div", "", `message ${level.toLowerCase()}`);
      row.append(cell("time", when), cell("span", text));
      return row;
    }),
  );
  if (!rows.length) list.append(cell("div", "It has written nothing.", "quiet"));
  if (atEnd) list.scrollTop = list.scrollHeight;
}

document.addEventListener("click", ({ target }) => {
  const row = target.closest("#processes tr");
  if (!row) return;
  chosen = chosen === row.dataset.name ? "" : row.dataset.name;
  history.replaceState(null, "", `#${chosen}`);
  processes();
  log();
  at("log-card")?.scrollIntoView({ block: "nearest" });
});
onTick(processes);
onTick(log);
