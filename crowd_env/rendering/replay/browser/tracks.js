// One recording: who is where at any time between its frames, and its curves.

const AVERAGE = 0.3; // s, over which pressures are averaged: what a body bears, not single blows

// Index of the last of ascending `values` that is not above `value`; -1 if all are.
function lastNotAbove(values, value) {
  let low = 0;
  let high = values.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] <= value) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

class Recording {
  constructor(about, columns) {
    Object.assign(this, columns);
    this.about = about;
    this.plan = this.layout = about.plan;
    const stack = this.plan.stack;
    if (stack) {
      const [x, y] = [0, 1].map((k) => stack.parts.flatMap(({ shells }) => shells.flat()).map((at) => at[k]));
      stack.bounds = [Math.min(...x), Math.min(...y), Math.max(...x), Math.max(...y)];
    }
    this.ways = { layout: [this.x, this.y], stack: [this.stack_x, this.stack_y] };
    this.people = this.radius.length;
    this.start = new Int32Array(this.people + 1);
    for (let n = 0; n < this.people; n++) this.start[n + 1] = this.start[n] + this.samples[n];
    this.end = this.times[this.times.length - 1];
    this.begin = this.times[0];
    this.step = this.times.length > 1 ? this.times[1] - this.times[0] : 1;
    this.pressed = this.pressure.some((value) => value > 0);
    this.pressure = this.averaged(this.pressure);
    // When a person is no longer counted: out, or inside to the end.
    this.leaving = Float32Array.from(this.exit_time, (time) => (time < 0 ? Infinity : time));
    this.leavings = Float32Array.from(this.leaving).sort();
    // When a person is first seen: in recordings of others not all are there from the beginning.
    const seen = Float32Array.from(this.first, (frame, n) => (this.samples[n] ? (this.times[frame] ?? Infinity) : Infinity));
    this.arrivals = seen.sort();
    this.exits = this.exitsByName();
    this.who = new Int32Array(this.people); // rows of people who are shown now
    for (const name of ["px", "py", "nowSpeed", "nowPressure", "nowAngle", "aheadX", "aheadY"]) {
      this[name] = new Float32Array(this.people);
    }
    this.shown = 0;
    this.isShown = new Uint8Array(this.people);
    this.meanPressure = this.pressureCurve();
    this.typicalRadius = Float32Array.from(this.radius).sort()[this.people >> 1] || 0.2;
  }

  averaged(values) {
    const half = Math.round((0.5 * AVERAGE) / this.step - 0.5 + 1e-3);
    if (half < 1) return values;
    const smooth = new Float32Array(values.length);
    for (let n = 0; n < this.people; n++) {
      for (let k = this.start[n]; k < this.start[n + 1]; k++) {
        const from = Math.max(k - half, this.start[n]);
        const to = Math.min(k + half, this.start[n + 1] - 1);
        let sum = 0;
        for (let m = from; m <= to; m++) sum += values[m];
        smooth[k] = sum / (to - from + 1);
      }
    }
    return smooth;
  }

  exitsByName() {
    const found = new Map();
    this.plan.exits.forEach(({ name, ends }, row) => {
      if (!found.has(name)) found.set(name, { name, ends: [], rows: new Set(), times: [] });
      found.get(name).ends.push(ends);
      found.get(name).rows.add(row);
    });
    for (const exit of found.values()) {
      for (let n = 0; n < this.people; n++) {
        if (exit.rows.has(this.exit_index[n]) && this.leaving[n] < Infinity) exit.times.push(this.leaving[n]);
      }
      exit.times.sort((a, b) => a - b);
    }
    return [...found.values()];
  }

  // Show the layout of a building, or its storeys above one another.
  show(name) {
    this.stacked = name === "stack";
    this.plan = this.stacked ? this.layout.stack : this.layout;
    [this.x, this.y] = this.ways[name];
    for (const exit of this.exits) exit.ends = [...exit.rows].map((row) => this.plan.exits[row].ends);
  }

  // Whether sample b is on another sheet than a, which lies elsewhere in the layout.
  leaps(a, b) {
    return Boolean(this.sheet) && !this.stacked && this.sheet[a] !== this.sheet[b];
  }

  // The sheet of a person at the time shown.
  sheetOf(n) {
    return this.sheet[Math.min(Math.max(this.start[n] + this.frame - this.first[n], this.start[n]), this.start[n + 1] - 1)];
  }

  inside(time) {
    return lastNotAbove(this.arrivals, time + 1e-6) - lastNotAbove(this.leavings, time);
  }

  // Mean over the people inside at each frame.
  pressureCurve() {
    const sum = new Float64Array(this.times.length);
    const inside = new Float64Array(this.times.length);
    for (let n = 0; n < this.people; n++) {
      for (let k = 0; k < this.samples[n]; k++) {
        const frame = this.first[n] + k;
        if (frame >= this.times.length || this.times[frame] >= this.leaving[n]) break;
        sum[frame] += this.pressure[this.start[n] + k];
        inside[frame] += 1;
      }
    }
    return sum.map((value, frame) => (inside[frame] ? value / inside[frame] : 0));
  }

  // Fill who is shown at `time` and where, between frames on straight lines.
  sample(time) {
    const { times, first, samples, until, start } = this;
    const over = time > this.end + 1e-6; // while another recording goes on
    time = Math.min(Math.max(time, this.begin), this.end);
    const frame = Math.max(lastNotAbove(times, time + 1e-6), 0);
    let shown = 0;
    this.isShown.fill(0);
    for (let n = 0; n < this.people; n++) {
      const k = frame - first[n];
      const last = samples[n] - 1;
      if (k < 0 || k > last || time > until[n] + 1e-6 || (over && this.leaving[n] < Infinity)) continue;
      const a = start[n] + k;
      const b = k < last && !this.leaps(a, a + 1) ? a + 1 : a;
      let part = 0;
      if (b > a) {
        const after = k + 1 === last ? until[n] : times[frame + 1];
        part = after > times[frame] ? Math.min(Math.max((time - times[frame]) / (after - times[frame]), 0), 1) : 0;
      }
      this.px[n] = this.x[a] + part * (this.x[b] - this.x[a]);
      this.py[n] = this.y[a] + part * (this.y[b] - this.y[a]);
      this.nowSpeed[n] = this.speed[a] + part * (this.speed[b] - this.speed[a]);
      this.nowPressure[n] = this.pressure[a] + part * (this.pressure[b] - this.pressure[a]);
      if (this.angle) this.nowAngle[n] = this.angle[a] + part * (this.angle[b] - this.angle[a]);
      // Where a person is heading: the way between the two frames, if there is any.
      const before = b > a || (a > start[n] && this.leaps(a - 1, a)) ? a : Math.max(a - 1, start[n]);
      const dx = this.x[b] - this.x[before];
      const dy = this.y[b] - this.y[before];
      const length = Math.hypot(dx, dy);
      const moves = length > 0.02 * this.step;
      this.aheadX[n] = moves ? dx / length : 0;
      this.aheadY[n] = moves ? dy / length : 0;
      this.who[shown++] = n;
      this.isShown[n] = 1;
    }
    this.shown = shown;
    this.time = time;
    this.frame = frame;
  }
}
