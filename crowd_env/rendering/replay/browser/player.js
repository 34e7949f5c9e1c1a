// The clock, the panes and all that is drawn in them.

const LAYOUT = "side by side";
const STACK = "one above another";
const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16];

class Pane {
  constructor(recording, label, series, player) {
    this.recording = recording;
    this.view = new View(recording.plan.bounds, recording.exits.length > 1);
    this.chosen = this.storey = -1;
    this.still = element("canvas", { className: "still" });
    this.moving = element("canvas", { className: "moving", tabIndex: 0 });
    this.moving.setAttribute("role", "img");
    this.moving.setAttribute("aria-label", `Plan with people${label ? `: ${label}` : ""}`);
    this.count = element("strong");
    this.counted = element("span", { className: "count" }, this.count, " inside");
    this.whole = element("button", { type: "button", className: "whole plain", textContent: "Show all", hidden: true });
    this.readout = element("p", { className: "readout", hidden: true });
    const dot = series < 0 ? [] : [swatch(`var(--series-${series})`)];
    this.head = element("div", { className: "head" }, ...dot, element("span", { textContent: label }), this.counted);
    this.box = element("div", { className: "box" }, this.still, this.moving, this.whole, this.readout);
    this.node = element("section", { className: series < 0 ? "pane single" : "pane" }, this.head, this.box);
    this.whole.addEventListener("click", () => {
      this.view.fit();
      player.viewChanged(this);
    });
    listenToView(this.moving, this.view, {
      changed: () => player.viewChanged(this),
      clicked: (x, y) => {
        const n = this.personAt(x, y);
        this.chosen = n === this.chosen ? -1 : n;
        player.draw();
      },
    });
  }

  personAt(x, y) {
    const { recording, view } = this;
    let [best, found] = [Infinity, -1];
    for (let k = 0; k < recording.shown; k++) {
      const n = recording.who[k];
      const away = Math.hypot(view.px(recording.px[n]) - x, view.py(recording.py[n]) - y);
      if (away < best) [best, found] = [away, n];
    }
    return best < Math.max(14, view.scale * recording.typicalRadius) ? found : -1;
  }

  // Show all sheets of a building side by side, one of them, or all above one another.
  show(name) {
    const { recording, view } = this;
    if (!recording.sheet) return;
    const storey = recording.layout.storeys.find((one) => one.name === name);
    this.storey = storey ? storey.sheet : -1;
    recording.show(name === STACK ? "stack" : "layout");
    view.bounds = storey ? storey.box : recording.plan.bounds;
    view.box = storey?.box;
    view.fit();
  }

  countOn(sheet) {
    const { who, shown, leaving, time } = this.recording;
    return who.slice(0, shown).filter((n) => leaving[n] > time && this.recording.sheetOf(n) === sheet).length;
  }

  // Keep the person chosen in sight while the time goes on; return the storey that it has come to, if one is shown.
  follow() {
    const { recording, view, chosen } = this;
    if (chosen < 0 || !recording.sheet || !recording.isShown[chosen]) return "";
    const sheet = recording.sheetOf(chosen);
    if (this.storey >= 0 && sheet !== this.storey) return recording.layout.storeys.find((one) => one.sheet === sheet).name;
    if (!view.fitted) view.center(recording.px[chosen], recording.py[chosen], view.scale);
    return "";
  }

  resize(ratio) {
    const { clientWidth, clientHeight } = this.box;
    for (const canvas of [this.still, this.moving]) {
      canvas.width = Math.max(Math.round(clientWidth * ratio), 1);
      canvas.height = Math.max(Math.round(clientHeight * ratio), 1);
    }
    this.view.resize(Math.max(clientWidth, 1), Math.max(clientHeight, 1), ratio);
  }

  drawStill(theme) {
    this.view.within(this.still, (context) => drawPlan(context, this.recording, this.view, theme));
    this.whole.hidden = this.view.fitted;
  }

  draw(time, theme, coloring, colors, options) {
    const { recording } = this;
    recording.sample(time);
    const chosen = this.chosen;
    this.view.within(this.moving, (context) =>
      drawPeople(context, recording, this.view, theme, coloring, colors, { ...options, chosen }));
    drawExitNames(this.moving.getContext("2d"), recording, this.view, theme);
    const here = this.storey >= 0 ? `${this.countOn(this.storey)} of ` : "";
    this.count.textContent = here + recording.inside(time);
    this.readout.hidden = chosen < 0;
    if (chosen >= 0) this.readout.textContent = this.aboutPerson(chosen, time);
  }

  aboutPerson(n, time) {
    const { recording } = this;
    const parts = [`Person ${n}`];
    if (recording.about.cohorts.length > 1) parts.push(recording.about.cohorts[recording.cohort[n]]);
    if (recording.isShown[n]) {
      parts.push(`${recording.nowSpeed[n].toFixed(2)} m/s`);
      if (recording.pressed) parts.push(`${recording.nowPressure[n].toFixed(0)} N/m`);
    }
    const left = recording.leaving[n];
    const exit = recording.exit_index[n] >= 0 ? recording.plan.exits[recording.exit_index[n]].name : "";
    const by = exit ? ` by ${exit}` : "";
    if (left === Infinity) parts.push("inside to the end");
    else parts.push(left > time ? `out in ${(left - time).toFixed(1)} s${by}` : `out at ${left.toFixed(1)} s${by}`);
    return parts.filter(Boolean).join(" · ");
  }
}

class Player {
  constructor(about, recordings) {
    this.about = about;
    this.recordings = recordings;
    this.begin = Math.min(...recordings.map((one) => one.begin));
    this.end = Math.max(...recordings.map((one) => one.end));
    this.step = Math.min(...recordings.map((one) => one.step));
    this.time = this.begin;
    this.rate = 1;
    this.playing = false;
    this.colorings = colorings(about, recordings);
    this.coloring = this.colorings[0];
    this.options = { forces: false, fullForce: fullForce(recordings) };
    const several = recordings.length > 1;
    this.panes = recordings.map((one, k) => {
      const label = several ? `${one.about.label} – ${one.about.outcome}` : "";
      return new Pane(one, label, several ? k : -1, this);
    });
    document.getElementById("plans").append(...this.panes.map((pane) => pane.node));
    this.charts = new Charts(document.getElementById("curves"), recordings, this.begin, this.end);
    // Plans of one place move together.
    this.linked = several && new Set(recordings.map((one) => JSON.stringify(one.plan.bounds))).size === 1;
    this.listeners = [];
    // What the control of storeys chooses from; nothing without a building.
    const storeys = recordings.flatMap((one) => one.layout.storeys ?? []).map(({ name }) => name);
    this.views = storeys.length ? [...new Set([LAYOUT, STACK, ...storeys])] : [];
    this.shown = LAYOUT;
  }

  resize() {
    this.ratio = Math.min(window.devicePixelRatio || 1, 2);
    for (const pane of this.panes) pane.resize(this.ratio);
    this.redraw();
  }

  redraw() {
    this.theme = readTheme();
    for (const pane of this.panes) pane.drawStill(this.theme);
    this.charts.draw(this.theme, this.ratio);
    this.draw();
  }

  viewChanged(pane) {
    for (const other of this.linked ? this.panes : [pane]) {
      if (other !== pane) other.view.follow(pane.view);
      other.drawStill(this.theme);
    }
    this.draw();
    for (const listener of this.listeners) listener();
  }

  draw() {
    for (const pane of this.panes) {
      pane.draw(this.time, this.theme, this.coloring, this.about.colors, this.options);
    }
    this.charts.moveCursor(this.time);
    this.drawn = (this.drawn || 0) + 1;
  }

  show(name) {
    this.shown = name;
    for (const pane of this.panes) pane.show(name);
    this.redraw();
    for (const listener of this.listeners) listener();
  }

  seek(time) {
    this.time = Math.min(Math.max(time, this.begin), this.end);
    this.draw();
    for (const pane of this.panes) {
      const name = pane.follow();
      if (name) this.show(name);
      else if (pane.chosen >= 0 && !pane.view.fitted) this.viewChanged(pane);
    }
    for (const listener of this.listeners) listener();
  }

  // The next or the last frame; from between two frames, the nearest in that direction.
  jumpFrames(frames) {
    const now = (this.time - this.begin) / this.step;
    const next = frames > 0 ? Math.floor(now + 0.02) + frames : Math.ceil(now - 0.02) + frames;
    this.pause();
    this.seek(this.begin + next * this.step);
  }

  play() {
    if (this.playing) return;
    if (this.time >= this.end) this.time = this.begin;
    this.playing = true;
    let before = performance.now();
    const tick = (now) => {
      if (!this.playing) return;
      const passed = Math.min(Math.max(now - before, 0), 250) / 1000;
      before = now;
      this.time = Math.min(this.time + passed * this.rate, this.end);
      if (this.time >= this.end) this.playing = false;
      else requestAnimationFrame(tick);
      this.seek(this.time);
    };
    requestAnimationFrame(tick);
    for (const listener of this.listeners) listener();
  }

  pause() {
    this.playing = false;
    for (const listener of this.listeners) listener();
  }
}

// The force of a line as wide as a body: nearly all contacts are below.
function fullForce(recordings) {
  const all = recordings.flatMap((one) => (one.contact_force ? [one.contact_force] : []));
  const sorted = all.map((values) => Float32Array.from(values).sort());
  return roundUp(Math.max(1, ...sorted.map((values) => values[Math.floor(0.99 * values.length)] || 0)));
}

function readTheme() {
  const style = getComputedStyle(document.documentElement);
  const color = (name) => style.getPropertyValue(`--${name}`).trim();
  return {
    background: color("background"), floor: color("floor"), wall: color("wall"), obstacle: color("obstacle"),
    exit: color("exit"), seam: color("seam"), mat: color("mat"), ink: color("ink"), quiet: color("quiet"), faint: color("faint"),
    rim: color("rim"), tick: color("tick"), force: color("force"), exitInk: color("exit-ink"), series: [color("series-0"), color("series-1")], zone: color("series-3"),
    font: getComputedStyle(document.body).fontFamily,
  };
}
