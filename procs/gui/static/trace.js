// A small plot of the newest seconds: lanes one above the other, one for each quantity, with several lines each.
const COLOURS = ["--s0", "--s1", "--s2", "--s3", "--s4", "--s5", "--s6", "--s7"];
export const MARKS = { fault: "--bad", error: "--bad", warning: "--warn", now: "--past" }; // colours of events in plots
const LANES = [
  { lines: [0, 1], title: "position", joint: true, least: 2e-4 },
  { lines: [2, 3], title: "velocity", joint: true, after: "/s", least: 2e-3 },
  { lines: [4, 5, 6], title: "effort", least: 1e-2 },
  { lines: [7], title: "error", joint: true, least: 2e-5 },
];
const GAP_S = 0.06; // longer silence is no line; in recordings, which have fewer samples, 0.5
const KEPT = 8000;

export class Trace {
  constructor(canvas, gap = GAP_S) {
    this.canvas = canvas;
    this.gap = gap;
    this.clear();
  }

  clear() {
    this.t = [];
    this.v = COLOURS.map(() => []);
  }

  add(times, columns) {
    for (let i = 0; i < times.length; i++) this.t.push(times[i]);
    columns.forEach((column, k) => { for (let i = 0; i < column.length; i++) this.v[k].push(column[i]); });
    const over = this.t.length - KEPT;
    if (over > KEPT / 4) for (const column of [this.t, ...this.v]) column.splice(0, over);
  }

  // `chosen`: numbers of signals; `factor`, `unit`: from rad or m to the displayed unit; `marks`: times with a kind of event.
  draw(chosen, span, factor, unit, effort, marks = []) {
    const { canvas } = this;
    const ratio = devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const paint = canvas.getContext("2d", { willReadFrequently: true }); // drawn by the processor: no graphics card is needed
    paint.setTransform(ratio, 0, 0, ratio, 0, 0);
    paint.clearRect(0, 0, width, height);
    const look = getComputedStyle(document.documentElement);
    const colour = (name) => look.getPropertyValue(name).trim();
    paint.font = "12px system-ui, sans-serif";
    const lanes = LANES.filter((lane) => lane.lines.some((k) => chosen.includes(k)));
    const end = this.t.length ? this.t[this.t.length - 1] : 0;
    let first = this.t.length;
    while (first > 0 && this.t[first - 1] >= end - span) first--;
    const left = 58;
    const tall = height / Math.max(1, lanes.length);
    const each = Math.max(1, Math.floor((this.t.length - first) / (2 * (width - left))));
    for (const [t, kind] of marks) {
      if (t < end - span || t > end) continue;
      paint.fillStyle = colour(MARKS[kind]);
      paint.fillRect(Math.round(left + ((t - end + span) / span) * (width - left)), 0, kind === "now" ? 2 : 1, height);
    }
    lanes.forEach((lane, row) => {
      const lines = lane.lines.filter((k) => chosen.includes(k));
      let [low, high] = [Infinity, -Infinity];
      for (const k of lines) for (let i = first; i < this.t.length; i++) {
        const v = this.v[k][i];
        if (v === null || v === undefined) continue;
        if (v < low) low = v;
        if (v > high) high = v;
      }
      const top = row * tall + 16;
      const bottom = (row + 1) * tall - 6;
      const scale = lane.joint ? factor : 1;
      paint.fillStyle = colour("--soft");
      paint.textAlign = "left";
      paint.fillText(`${lane.title} ${lane.joint ? unit + (lane.after || "") : effort}`, left, row * tall + 11);
      paint.strokeStyle = colour("--line");
      paint.strokeRect(left + 0.5, Math.round(top) + 0.5, width - left - 1, Math.round(bottom - top));
      if (low > high) return;
      const missing = lane.least - (high - low);
      if (missing > 0) [low, high] = [low - missing / 2, high + missing / 2];
      const y = (v) => bottom - ((v - low) / (high - low)) * (bottom - top - 6) - 3;
      paint.textAlign = "right";
      const digits = Math.max(0, Math.min(5, 1 - Math.floor(Math.log10((high - low) * scale))));
      paint.fillText((high * scale).toFixed(digits), left - 5, top + 9);
      paint.fillText((low * scale).toFixed(digits), left - 5, bottom);
      for (const k of [...lines].reverse()) {
        paint.strokeStyle = colour(COLOURS[k]);
        paint.lineWidth = k % 2 && lines.length > 1 ? 5 : 2; // the setpoint below the measured value: both are visible
        paint.beginPath();
        let before = -Infinity;
        for (let i = first; i < this.t.length; i += each) {
          const v = this.v[k][i];
          if (v === null || v === undefined) { before = -Infinity; continue; }
          const x = left + ((this.t[i] - end + span) / span) * (width - left);
          if (this.t[i] - before > Math.max(this.gap, 3 * each * 0.002)) paint.moveTo(x, y(v));
          else paint.lineTo(x, y(v));
          before = this.t[i];
        }
        paint.stroke();
      }
    });
    if (!this.t.length) {
      paint.fillStyle = colour("--soft");
      paint.textAlign = "center";
      paint.fillText("no samples yet", width / 2, height / 2);
    }
  }
}
