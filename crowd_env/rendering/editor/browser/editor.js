// Tools, keys, pointer, and what is asked of the server.

const TOOLS = [
  ["select", "Select", "V", "Click what is to be changed; drag moves the plan, the wheel zooms."],
  ["exit", "Exit", "E", "Click both ends of the exit on the edge of the floor."],
  ["door", "Door", "D", "Click both ends of the door, across a passage."],
  ["start", "People", "P", "Click two opposite corners, or each corner and the first one again: people start there."],
  ["stairs", "Stairs", "S", "Click the corners of an area where people are slower."],
  ["region", "Area", "A", "Click the corners of an area that has a name."],
  ["section", "Count", "C", "Click both ends of a line: people who cross it are counted."],
  ["wall", "Wall", "W", "Click the points of a wall; Enter ends it."],
  ["block", "Obstacle", "O", "Click the corners of what people cannot walk on."],
];

const TWO_POINTS = ["exit", "door", "section"];

class Editor {
  constructor(about) {
    this.about = about;
    this.project = new Project(about.content);
    this.tool = "select";
    this.selected = null;
    this.draft = [];
    this.pointer = null;
    this.marks = [];
    this.snapper = new Snapper();
    this.project.saved = JSON.stringify(about.saved);
    this.revision = about.revision; // of the file
    this.asked = 0;
    this.read = ""; // how the drawing was read when its layers came last
    this.canvas = byId("canvas");
    this.view = new View([0, 0, 10, 10], false);
    this.listen();
    this.choose("select");
    if (about.shown) this.take(about.shown);
    this.check();
    if (about.running) followRun(this);
  }

  say(text) {
    byId("state").textContent = text;
  }

  async ask(what, given) {
    try {
      const answer = await fetch(what, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(given) });
      return answer.ok ? await answer.json() : { failed: `the command has answered ${answer.status}` };
    } catch {
      return { failed: "the command that serves this page has ended; start it again, then reload" };
    }
  }

  // Ask what is understood of the project now, and show it.
  async check() {
    this.refresh();
    if (!this.about.served) return this.say("This page stands alone: Save hands back the project, crowd-env plan checks it.");
    const number = (this.asked += 1);
    const { file, unit, level, layers, origin } = this.project.geometry;
    const read = JSON.stringify([file, unit, level, layers, origin]);
    this.say("checking ...");
    const shown = await this.ask("check", { content: this.project.content, layers: read !== this.read });
    if (number !== this.asked) return;
    if (shown.failed) return this.say(shown.failed);
    if (read !== this.read) this.read = read;
    else for (const key of ["layers", "levels"]) shown[key] = this.project.shown[key];
    this.take(shown);
    this.say(this.told || (this.project.changed ? "not saved" : ""));
  }

  take(shown) {
    const old = this.project.shown;
    for (const key of ["floor", "area", "capacity", "drawn"]) shown[key] ??= old[key]; // of before, where there is none now
    this.project.shown = shown;
    const bounds = boundsOf(shown);
    const choose = (shown.levels || []).length > 1 && !this.project.geometry.level;
    if (choose || (!shown.floor && (shown.layers || []).length)) byId("layers-of").open = true;
    if (bounds && !this.known) {
      this.view.bounds = bounds;
      this.view.fit();
      this.known = true;
    } else if (bounds) this.view.bounds = bounds;
    this.refresh();
  }

  refresh() {
    const { project } = this;
    if (this.selected && this.selected.kind !== "layer" && !project.elements().some((one) => same(one, this.selected))) this.selected = null;
    const shown = project.shown;
    const floor = shown.floor ? [...shown.floor.shells, ...shown.floor.holes].map(closed) : [];
    const layers = (shown.layers || []).flatMap((layer) => layer.shapes.flat());
    this.snapper.take([...floor, ...layers, ...project.elements().flatMap((one) => project.shape(one.kind, one.name))]);
    byId("undo").disabled = !project.before.length;
    byId("redo").disabled = !project.after.length;
    showPanel(this);
    this.draw();
  }

  draw() {
    cancelAnimationFrame(this.frame);
    this.frame = requestAnimationFrame(() => drawPicture(this.canvas.getContext("2d"), this.view, this));
  }

  resized() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width) return; // hidden
    const ratio = window.devicePixelRatio || 1;
    [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    this.view.resize(width, height, ratio);
    this.draw();
  }

  // Change the project by a function, which may return what is to be told; then look at it anew.
  act(by, selected = this.selected) {
    const told = by();
    this.told = typeof told === "string" ? told : "";
    this.selected = selected;
    this.marks = [];
    this.check();
  }

  change(by) {
    this.act(() => this.project.change(by));
  }

  choose(tool) {
    this.tool = tool;
    this.draft = [];
    for (const one of byId("tools").children) one.setAttribute("aria-pressed", String(one.dataset.tool === tool));
    byId("hint").textContent = TOOLS.find(([name]) => name === tool)[3];
    this.draw();
  }

  select(one) {
    this.selected = one;
    if (this.tool !== "select") this.choose("select");
    this.refresh();
  }

  rename(to) {
    const { selected, project } = this;
    if (project.rename(selected, to)) return this.act(() => {}, { ...selected, name: to });
    this.refresh(); // the old name stands there again
    if (to !== selected.name) this.say(to ? `there is another ${to}: ${selected.name} keeps its name` : "a name cannot be empty");
  }

  remove() {
    const one = this.selected;
    if (!one || one.kind === "layer") return;
    this.act(() => {
      const gone = this.project.remove(one);
      if (gone.length) return `with ${one.name} its routes are gone: ${gone.join(", ")}`;
      return this.project.elements().some((other) => same(other, { ...one, kind: "region" })) ? `${one.name} is of the drawing: it stays, without people` : "";
    }, null);
  }

  showPlaces(points) {
    this.marks = points;
    if (points.length) {
      const [x, y] = points[0];
      this.view.center(x, y, Math.max(this.view.scale, this.view.fitScale() * 2));
      this.view.fitted = false;
    }
    this.draw();
  }

  // A point is clicked or chosen by a key.
  point(x, y, free) {
    if (this.tool === "select") return this.pick(x, y);
    const { x: px, y: py } = this.snapper.at(x, y, this.view.scale, free);
    const near = ([ax, ay]) => Math.hypot(ax - px, ay - py) * this.view.scale < 9;
    const line = !AREAS.includes(this.tool);
    if (this.draft.length && near(this.draft.at(-1))) return this.finish();
    if (!line && this.draft.length > 2 && near(this.draft[0])) return this.finish();
    this.draft.push([px, py]);
    if (TWO_POINTS.includes(this.tool) && this.draft.length === 2) return this.finish();
    this.draw();
  }

  finish() {
    const { tool, draft } = this;
    const line = !AREAS.includes(tool);
    if (draft.length < 2) return;
    const points = !line && draft.length === 2 ? rectangleOf(...draft).slice(0, 4) : draft;
    this.draft = [];
    const made = this.project.add(tool, points);
    this.choose("select");
    this.act(() => {}, made);
  }

  // Select what lies at a point: lines first, then areas, the smallest first, then layers.
  pick(x, y) {
    const near = 9 / this.view.scale;
    const found = this.project.elements().map((one) => ({ one, lines: this.project.shape(one.kind, one.name) }));
    const lines = found.map(({ one, lines }) => ({ one, apart: Math.min(...lines.map((line) => distanceTo(line, x, y))) }))
      .filter(({ apart }) => apart < near).sort((a, b) => a.apart - b.apart);
    const areas = found.filter(({ one, lines }) => AREAS.includes(one.kind) && lines.some((line) => inside(line, x, y)))
      .sort((a, b) => areaOf(a.lines[0]) - areaOf(b.lines[0]));
    const layer = (this.project.shown.layers || []).map((one) => ({ name: one.name, apart: Math.min(Infinity, ...one.shapes.flat().map((line) => distanceTo(line, x, y))) }))
      .filter(({ apart }) => apart < near).sort((a, b) => a.apart - b.apart)[0];
    this.select((lines[0] || areas[0] || {}).one || (layer ? { kind: "layer", name: layer.name } : null));
  }

  async save() {
    if (!this.about.served) {
      const name = this.about.file.replace(/\.[^.]*$/, "") + ".json";
      const link = element("a", { download: name, href: URL.createObjectURL(new Blob([JSON.stringify(this.project.content, null, 2)])) });
      link.click();
      this.project.saved = JSON.stringify(this.project.content);
      return this.say(`${name} is handed back; put it beside the drawing`);
    }
    this.keep(await this.ask("save", { content: this.project.content, revision: this.revision }));
  }

  // Take the answer of what has saved; a second try overwrites what another has saved meanwhile.
  keep(answer) {
    this.revision = answer.revision ?? this.revision;
    this.say(answer.failed || `saved: ${answer.saved}${answer.kept ? `; what was there is kept as ${answer.kept}` : ""}`);
    if (!answer.failed) this.project.saved = JSON.stringify(this.project.content);
    return !answer.failed;
  }

  async run() {
    const problem = this.project.shown.error;
    if (problem) return this.say(`not yet: ${problem}`);
    const runs = Number(byId("runs").value) || 10;
    if (this.keep(await this.ask("run", { content: this.project.content, revision: this.revision, runs }))) await followRun(this);
  }

  listen() {
    const { canvas, view } = this;
    for (const [tool, word, key, hint] of TOOLS) {
      const made = button(word, () => { this.choose(tool); canvas.focus(); }, { title: hint });
      made.dataset.tool = tool;
      made.append(element("kbd", { textContent: key }));
      byId("tools").append(made);
    }
    const runs = element("input", { type: "number", id: "runs", value: 10, min: 1, max: 1000, title: "evacuations", style: "width: 5em", aria: { "aria-label": "Evacuations" } });
    byId("run").before(runs);
    const step = (done) => done && this.check();
    byId("undo").addEventListener("click", () => step(this.project.undo()));
    byId("redo").addEventListener("click", () => step(this.project.redo()));
    byId("save").addEventListener("click", () => this.save());
    byId("run").addEventListener("click", () => this.run());
    byId("run").disabled = runs.disabled = !this.about.served;
    window.addEventListener("beforeunload", (event) => this.project.changed && event.preventDefault());
    new ResizeObserver(() => this.resized()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    this.listenToHandles();
    listenToView(canvas, view, {
      changed: () => this.draw(),
      clicked: (px, py) => this.point(...this.meters(px, py)),
      twice: () => (this.draft.length ? this.finish() : (view.fit(), this.draw())),
    });
    canvas.addEventListener("pointermove", (event) => this.moved(event));
    canvas.addEventListener("pointerleave", () => { this.pointer = null; this.draw(); });
    canvas.addEventListener("blur", () => (byId("where").textContent = ""));
    document.addEventListener("keydown", (event) => this.key(event));
  }

  meters(px, py) {
    return [(px - this.view.left) / this.view.scale, (this.view.top - py) / this.view.scale];
  }

  moved(event) {
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = this.meters(event.clientX - box.left, event.clientY - box.top);
    this.key_at = [x, y];
    this.pointTo(x, y, event.altKey);
  }

  pointTo(x, y, free) {
    this.pointer = { ...(this.tool === "select" ? { x, y, what: "" } : this.snapper.at(x, y, this.view.scale, free)) };
    const last = this.draft.at(-1);
    const length = last ? `, ${Math.hypot(this.pointer.x - last[0], this.pointer.y - last[1]).toFixed(2)} m` : "";
    byId("where").textContent = `${this.pointer.x.toFixed(2)}, ${this.pointer.y.toFixed(2)}${length}${this.pointer.what ? ` on ${this.pointer.what}` : ""}`;
    this.draw();
  }

  // Dragging a corner of what is selected; it comes before the plan is moved.
  listenToHandles() {
    const { canvas } = this;
    let held = null;
    const at = (event) => {
      const box = canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button || this.tool !== "select" || !this.selected || this.selected.kind === "layer") return;
      const [px, py] = at(event);
      const handles = this.project.handles(this.selected);
      const k = handles.findIndex(([x, y]) => Math.hypot(this.view.px(x) - px, this.view.py(y) - py) < 10);
      if (k < 0) return;
      event.stopImmediatePropagation();
      canvas.setPointerCapture(event.pointerId);
      held = { k, points: handles.map((point) => [...point]), moved: false };
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!held) return;
      const found = this.snapper.at(...this.meters(...at(event)), this.view.scale, event.altKey);
      held.points[held.k] = [found.x, found.y];
      held.moved = true;
      this.marks = [held.points[held.k]];
      this.draw();
    });
    canvas.addEventListener("pointerup", (event) => {
      if (!held) return;
      event.stopImmediatePropagation();
      const { points, moved } = held;
      held = null;
      if (moved) this.act(() => this.project.reshape(this.selected, points));
    });
  }

  key(event) {
    const typing = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName);
    const command = event.ctrlKey || event.metaKey;
    const letter = event.key.length === 1 ? event.key.toUpperCase() : event.key;
    const done = () => event.preventDefault();
    if (command && letter === "S") return done(), this.save();
    if (typing) return;
    if (command && letter === "Z") return done(), byId(event.shiftKey ? "redo" : "undo").click();
    if (command && letter === "Y") return done(), byId("redo").click();
    if (command || event.altKey) return;
    const tool = TOOLS.find(([, , key]) => key === letter);
    if (tool) return done(), this.choose(tool[0]), this.canvas.focus();
    if (letter === "Escape") return this.draft.length ? ((this.draft = []), this.draw()) : this.tool === "select" ? this.select(null) : this.choose("select");
    if (document.activeElement !== this.canvas) return;
    if (letter === "Delete" || letter === "Backspace") return done(), this.remove();
    const { view } = this;
    if (letter === "+" || letter === "=") return view.zoom(1.25, view.width / 2, view.height / 2), this.draw();
    if (letter === "-") return view.zoom(0.8, view.width / 2, view.height / 2), this.draw();
    if (letter === "0") return view.fit(), this.draw();
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[letter];
    if (way) {
      done();
      const step = (event.shiftKey ? 60 : 6) / view.scale;
      const from = this.key_at || this.meters(view.width / 2, view.height / 2);
      this.key_at = [from[0] + way[0] * step, from[1] + way[1] * step];
      return this.pointTo(...this.key_at, false);
    }
    if (letter === " " && this.pointer) return done(), this.point(this.pointer.x, this.pointer.y, false);
    if (letter === "Enter") {
      done();
      if (this.draft.length > 1 && !TWO_POINTS.includes(this.tool)) return this.finish();
      if (this.pointer) this.point(this.pointer.x, this.pointer.y, false);
    }
  }
}

const same = (one, other) => one.kind === other.kind && one.name === other.name;

function boundsOf(shown) {
  const points = [...((shown.floor || {}).shells || []), ...(shown.layers || []).flatMap((layer) => layer.shapes.flat())].flat();
  if (!points.length) return null;
  const [xs, ys] = [points.map(([x]) => x), points.map(([, y]) => y)];
  const least = (all) => all.reduce((a, b) => Math.min(a, b));
  const most = (all) => all.reduce((a, b) => Math.max(a, b));
  return [least(xs), least(ys), most(xs), most(ys)];
}

const editor = new Editor(JSON.parse(byId("about").textContent));
document.body.classList.add("ready");
