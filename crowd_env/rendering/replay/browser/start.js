// Controls and keys, and the first picture.

const byId = (id) => document.getElementById(id);
const PLAY = "M7 4.5v15l13-7.5z";
const PAUSE = "M6 4.5h4.5v15H6zM13.5 4.5H18v15h-4.5z";
const KEYS = [
  ["Space", "play, pause"],
  ["← →", "one frame"],
  ["Shift ← →", "one second"],
  ["Home, End", "start, end"],
  ["< >", "slower, faster"],
  ["C", "next color"],
  ["F", "forces, if recorded"],
  ["N", "next person"],
  ["+ − 0", "zoom, show all"],
];

function listen(player) {
  const { about } = player;
  const [play, scrub, speed, color, forces, storey] = ["play", "scrub", "speed", "color", "forces", "storey"].map(byId);
  storey.append(...player.views.map((name) => element("option", { value: name, textContent: name })));
  byId("storey-field").hidden = !player.views.length;
  storey.addEventListener("change", () => player.show(storey.value));
  if (player.views.length) KEYS.push(["Page ↑ ↓", "next storey"]);
  speed.append(...SPEEDS.map((rate) => element("option", { value: rate, textContent: `${rate}×` })));
  color.append(...player.colorings.map(({ key, name }) => element("option", { value: key, textContent: name })));
  speed.value = "1";
  scrub.min = player.begin;
  scrub.max = player.end;

  const legend = () => {
    showLegend(byId("legend"), about, player.coloring);
    if (player.options.forces) showForceLegend(byId("legend"), player);
  };
  const show = () => {
    const state = player.playing ? "Pause" : "Play";
    if (play.getAttribute("aria-label") !== state) {
      play.setAttribute("aria-label", state);
      play.querySelector("path").setAttribute("d", player.playing ? PAUSE : PLAY);
    }
    scrub.value = player.time;
    storey.value = player.shown;
    const text = `${player.time.toFixed(1)} / ${player.end.toFixed(1)} s`;
    byId("clock").textContent = text;
    scrub.setAttribute("aria-valuetext", text);
  };
  player.listeners.push(show, () => player.options.forces && legend());

  const toggle = () => (player.playing ? player.pause() : player.play());
  const choose = (key) => {
    player.coloring = player.colorings.find((one) => one.key === key);
    color.value = key;
    legend();
    player.draw();
  };
  const showForces = (on) => {
    player.options.forces = forces.checked = on;
    legend();
    player.draw();
  };
  play.addEventListener("click", toggle);
  speed.addEventListener("change", () => (player.rate = Number(speed.value)));
  color.addEventListener("change", () => choose(color.value));
  forces.addEventListener("change", () => showForces(forces.checked));
  scrub.addEventListener("input", () => {
    if (player.playing) player.pause();
    player.seek(Number(scrub.value));
  });
  const recorded = player.recordings.some((one) => one.contact_start);
  byId("forces-field").hidden = !recorded;
  listenToCurves(byId("curves"), player);
  listenToFacts(byId("facts-button"), byId("facts"), player);

  const faster = (by) => {
    const k = Math.min(Math.max(SPEEDS.indexOf(player.rate) + by, 0), SPEEDS.length - 1);
    player.rate = SPEEDS[k];
    speed.value = String(player.rate);
  };
  const zoom = (factor) => {
    const pane = player.panes.find((one) => one.box.contains(document.activeElement)) || player.panes[0];
    if (factor) pane.view.zoom(factor, pane.view.width / 2, pane.view.height / 2);
    else pane.view.fit();
    player.viewChanged(pane);
  };
  const nextColor = () => {
    const k = player.colorings.indexOf(player.coloring);
    choose(player.colorings[(k + 1) % player.colorings.length].key);
  };
  const nextStorey = (by) => player.views.length && player.show(player.views.at((player.views.indexOf(player.shown) + by) % player.views.length));
  const nextPerson = () => {
    for (const pane of player.panes) {
      const { who, shown } = pane.recording;
      pane.chosen = Math.min(...who.slice(0, shown).filter((n) => n > pane.chosen), Infinity);
      if (pane.chosen === Infinity) pane.chosen = -1;
    }
    player.seek(player.time);
  };
  const beforePrint = { name: "" };
  addEventListener("beforeprint", () => {
    beforePrint.name = player.shown;
    if (player.shown !== LAYOUT) player.show(LAYOUT);
  });
  addEventListener("afterprint", () => player.shown !== beforePrint.name && player.show(beforePrint.name));
  const keys = {
    PageUp: () => nextStorey(-1), PageDown: () => nextStorey(1), n: nextPerson, N: nextPerson,
    " ": toggle,
    ArrowLeft: (event) => (event.shiftKey ? player.seek(player.time - 1) : player.jumpFrames(-1)),
    ArrowRight: (event) => (event.shiftKey ? player.seek(player.time + 1) : player.jumpFrames(1)),
    Home: () => player.seek(player.begin),
    End: () => player.seek(player.end),
    "<": () => faster(-1), ",": () => faster(-1), ">": () => faster(1), ".": () => faster(1),
    c: nextColor, C: nextColor,
    f: () => recorded && showForces(!player.options.forces), F: () => recorded && showForces(!player.options.forces),
    "+": () => zoom(1.4), "=": () => zoom(1.4), "-": () => zoom(1 / 1.4), "0": () => zoom(0),
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !keys[event.key]) return;
    const at = document.activeElement;
    if (at instanceof HTMLSelectElement && event.key !== "<" && event.key !== ">") return;
    if (event.key === " " && (at instanceof HTMLButtonElement || at === forces)) return; // it presses them
    event.preventDefault();
    keys[event.key](event);
  });
  legend();
  show();
}

// Lines of three forces, as wide as they are on the plan now.
function showForceLegend(place, player) {
  const { recording, view } = player.panes[0];
  const entries = [0.25, 0.5, 1].map((part) => {
    const force = part * player.options.fullForce;
    const line = element("i", { className: "line" });
    line.style.height = `${Math.min(Math.max(forceWidth(force, player.options.fullForce, recording, view), 0.5), 24)}px`;
    return element("span", { className: "entry" }, line, `${Number(force.toPrecision(3))}${part === 1 ? " N" : ""}`);
  });
  place.querySelector(".force")?.remove();
  place.append(element("span", { className: "force", title: "Normal contact force in one physics step, at the frame before" }, ...entries));
}

function listenToCurves(place, player) {
  const seek = (event) => {
    if (player.playing) player.pause();
    player.seek(player.charts.timeAt(event.clientX - place.getBoundingClientRect().left));
  };
  place.addEventListener("pointerdown", (event) => {
    place.setPointerCapture(event.pointerId);
    seek(event);
  });
  place.addEventListener("pointermove", (event) => {
    if (place.hasPointerCapture(event.pointerId)) seek(event);
  });
  const names = player.charts.charts.map((chart) => chart.name.toLowerCase()).join(" and ");
  place.setAttribute("aria-label", `Curves over time: ${names}`);
}

function listenToFacts(button, panel, player) {
  const open = (on) => {
    panel.hidden = !on;
    button.setAttribute("aria-expanded", String(on));
    player.resize();
    (on ? panel : button).focus({ preventScroll: true });
  };
  const close = element("button", { type: "button", className: "plain close", textContent: "Close" });
  panel.append(element("div", { className: "panel-head" }, element("h2", { textContent: "Facts" }), close));
  const all = player.recordings.map(({ about }) => about);
  const several = all.length > 1;
  all.forEach((about, k) => {
    const mark = several ? [swatch(`var(--series-${k})`), ` ${about.label}: `] : [];
    const end = several ? about.outcome : about.outcome[0].toUpperCase() + about.outcome.slice(1);
    panel.append(element("p", {}, ...mark, `${end}. ${about.note}`));
  });
  const facts = all.map((about) => new Map(about.facts));
  const names = [...new Set(facts.flatMap((one) => [...one.keys()]))];
  panel.append(table(names.map((name) => [name, ...facts.map((one) => one.get(name) ?? "–")])));
  panel.append(element("h3", { textContent: "Keys" }), table(KEYS));
  panel.append(element("p", { className: "quiet", textContent:
    "Drag moves the plan, the wheel or two fingers zoom, a double click shows all; a click on a person shows its way, and follows it where you have zoomed in. " +
    "Between frames people are drawn on straight lines; pressures are means of 0.3 s, forces those of one physics step." }));
  button.addEventListener("click", () => open(panel.hidden));
  close.addEventListener("click", () => open(false));
  panel.addEventListener("keydown", (event) => event.key === "Escape" && open(false));
}

function table(rows) {
  const line = ([name, ...values]) => {
    const differ = new Set(values).size > 1;
    const cells = values.map((value) => element("td", { className: differ ? "differs" : "", textContent: value }));
    return element("tr", {}, element("th", { scope: "row", textContent: name }), ...cells);
  };
  return element("table", {}, element("tbody", {}, ...rows.map(line)));
}

async function start() {
  const message = byId("message");
  try {
    if (typeof DecompressionStream === "undefined") {
      throw new Error("this browser is too old: it lacks DecompressionStream (Chrome 80, Safari 16.4, Firefox 113)");
    }
    const about = JSON.parse(byId("about").textContent);
    const recordings = [];
    for (const [k, one] of about.recordings.entries()) {
      const block = byId(`recording-${k}`);
      const bytes = await inflated(block.textContent);
      block.remove(); // a large text is not kept twice
      recordings.push(new Recording(one, unpacked(bytes, one.columns)));
    }
    const player = new Player(about, recordings);
    window.replay = player; // for a console
    player.resize();
    listen(player);
    message.remove();
    new ResizeObserver(() => player.resize()).observe(byId("plans"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => player.redraw());
    document.body.classList.add("ready");
  } catch (error) {
    message.textContent = `The recording cannot be shown: ${error.message}`;
    throw error;
  }
}

start();
