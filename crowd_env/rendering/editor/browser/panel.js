// The panel beside the plan: what is wrong, what is selected, lists of elements and layers, people.

const byId = (id) => document.getElementById(id);
const ROLE_WORDS = {
  "": "as it is named", walkable: "floor", obstacles: "wall, obstacle", exits: "exit", doors: "door", starts: "start area",
  regions: "area with a name", left_out: "left out",
};
const POINT = /\((-?\d+(?:\.\d+)?), (-?\d+(?:\.\d+)?)\)/g;

function element(tag, fields = {}, children = []) {
  const made = Object.assign(document.createElement(tag), fields);
  for (const [name, value] of Object.entries(fields.aria || {})) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

function field(label, ...inputs) {
  return element("label", { className: "field" }, [element("span", { textContent: label }), ...inputs]);
}

function numberInput(value, set, more = {}) {
  const input = element("input", { type: "number", step: "any", value: value ?? "", ...more });
  input.addEventListener("change", () => set(input.value === "" ? undefined : Number(input.value)));
  return input;
}

function choice(options, value, set, label, id = "") {
  const select = element("select", { id, aria: label ? { "aria-label": label } : {} });
  for (const [key, word] of options) select.append(element("option", { value: key, textContent: word }));
  select.value = value;
  select.addEventListener("change", () => set(select.value));
  return select;
}

function button(text, act, more = {}) {
  const made = element("button", { type: "button", textContent: text, ...more });
  made.addEventListener("click", act);
  return made;
}

function showPanel(editor) {
  const focused = document.activeElement && document.activeElement.id;
  showProblems(editor);
  showSelected(editor);
  showElements(editor);
  showPeople(editor);
  showLayers(editor);
  showNotes(editor);
  if (focused && document.activeElement.id !== focused && byId(focused)) byId(focused).focus();
}

// A message that shows the places it names when it is clicked.
function placed(editor, text, className) {
  const points = [...text.matchAll(POINT)].map(([, x, y]) => [Number(x), Number(y)]);
  return element("li", {}, [points.length ? button(text, () => editor.showPlaces(points), { className }) : element("p", { className, textContent: text })]);
}

function showProblems(editor) {
  const { shown } = editor.project;
  const problems = [shown.error, ...(shown.remarks || [])].filter(Boolean);
  const rows = problems.map((text) => placed(editor, text, "problem"));
  const facts = shown.floor ? `${shown.area.toFixed(1)} m² of floor, people: ${shown.count || 0}, room for about ${shown.capacity}` : "";
  const fine = problems.length || !shown.floor ? [] : [element("p", { className: "good", textContent: "Nothing stands in the way of a run." })];
  byId("problems").replaceChildren(
    element("h2", { textContent: problems.length ? `To be looked at (${problems.length})` : "Ready" }),
    element("ul", {}, rows), ...fine, element("p", { className: "quiet", textContent: facts }),
  );
}

function showSelected(editor) {
  const { selected, project } = editor;
  const box = byId("selected");
  box.hidden = !selected;
  if (!selected) return;
  if (selected.kind === "layer") {
    const roles = Object.entries(ROLE_WORDS).map(([role, word]) =>
      button(word, () => editor.act(() => project.giveRole(selected.name, role)), {
        aria: { "aria-pressed": String(project.roleOfLayer(selected.name) === role) },
      }));
    box.replaceChildren(element("h2", { textContent: `Layer ${selected.name}` }), element("p", { textContent: "What it draws is" }),
      element("div", { className: "row", style: "flex-wrap: wrap" }, roles));
    return;
  }
  const { word } = KINDS[selected.kind];
  const named = typeof selected.name === "string";
  const rows = [element("h2", { textContent: named ? `${word} ${selected.name}` : `${word} ${selected.name + 1}` })];
  if (named) {
    const input = element("input", { type: "text", id: "name", value: selected.name });
    input.addEventListener("change", () => editor.rename(input.value.trim()));
    rows.push(field("Name", input));
  }
  const lines = project.shape(selected.kind, selected.name);
  if (lines.length && !AREAS.includes(selected.kind)) rows.push(...fieldsOfLine(editor, lines));
  else if (lines.length) rows.push(element("p", { className: "quiet", textContent: sizeOf(selected.kind, lines) }));
  if (selected.kind === "door" || selected.kind === "exit") rows.push(...fieldsOfDoor(editor));
  if (selected.kind === "start") rows.push(...project.cohortsAt(selected.name).flatMap((one) => fieldsOfPeople(editor, one)));
  if (selected.kind === "region")
    rows.push(element("div", { className: "row" }, [
      button("People start here", () => editor.act(() => project.change((content) => putPeople(content, selected.name)), { ...selected, kind: "start" })),
      button("Stairs", () => editor.act(() => project.change((content) => (content.zones ||= []).push({ region: selected.name, factor: 0.6 })), { ...selected, kind: "stairs" })),
    ]));
  for (const zone of project.content.zones || []) {
    const key = zone.speed === undefined ? "factor" : "speed";
    if (zone.region === selected.name && KINDS[selected.kind].group === "regions") rows.push(field(
      key === "speed" ? "Speed there, m/s" : "Speed there, times",
      numberInput(zone[key], (value) => editor.change((content) => {
        content.zones.find((one) => one.region === selected.name)[key] = value ?? 1;
      }), { min: 0.05, max: 5 })));
  }
  rows.push(element("div", { className: "row" }, [button("Delete", () => editor.remove(), { title: "Del" })]));
  box.replaceChildren(...rows);
}

// Rings of holes count too; they are rare in areas.
function sizeOf(kind, lines) {
  const sum = lines.reduce((all, line) => all + (AREAS.includes(kind) ? areaOf(line) : lengthOf(line)), 0);
  return AREAS.includes(kind) ? `${sum.toFixed(1)} m²` : `${sum.toFixed(2)} m`;
}

// The width of a straight line may be typed: its middle stays.
function fieldsOfLine(editor, lines) {
  const line = lines[0];
  const width = lines.reduce((sum, one) => sum + lengthOf(one), 0);
  if (lines.length > 1 || line.length !== 2) return [element("p", { className: "quiet", textContent: `${width.toFixed(2)} m` })];
  const set = (value) => {
    if (!(value > 0)) return;
    const [[ax, ay], [bx, by]] = line;
    const [mx, my] = [(ax + bx) / 2, (ay + by) / 2];
    const [ux, uy] = [(bx - ax) / width, (by - ay) / width];
    editor.act(() => editor.project.reshape(editor.selected, [[mx - (ux * value) / 2, my - (uy * value) / 2], [mx + (ux * value) / 2, my + (uy * value) / 2]]));
  };
  return [field("Width, m", numberInput(width.toFixed(2), set, { min: 0.02, step: 0.05, id: "width" }))];
}

// A door, or an exit that a door closes: closed at first, and when it opens or closes.
function fieldsOfDoor(editor) {
  const { project, selected } = editor;
  const doors = Object.entries(project.table("doors"));
  const door = selected.kind === "door" ? selected.name : (doors.find(([, shape]) => shape === selected.name) || [])[0];
  const shut = (project.content.closed_doors || []).includes(door);
  const event = (project.content.door_events || []).find((one) => one.door === door && one.at !== undefined);
  const named = (content) => {
    const name = door || `door of ${selected.name}`;
    if (!door) content.geometry.doors = { ...content.geometry.doors, [name]: selected.name };
    return name;
  };
  const set = (state, at) => editor.act(() => project.change((content) => {
    const name = named(content);
    content.closed_doors = (content.closed_doors || []).filter((one) => one !== name);
    content.door_events = (content.door_events || []).filter((one) => one.door !== name);
    if (state === "shut" || state === "opens") content.closed_doors.push(name);
    if (state === "opens" || state === "closes") content.door_events.push({ door: name, opens: state === "opens", at: at ?? 30 });
  }));
  const state = event ? (event.opens ? "opens" : "closes") : shut ? "shut" : "open";
  const states = [["open", "is open"], ["shut", "is closed"], ["opens", "opens at"], ["closes", "closes at"]];
  const rows = [field("Door", choice(states, state, (to) => set(to, event && event.at)))];
  const gate = (project.content.gates || []).find((one) => one.door === door && door);
  rows.push(field("People per second", numberInput((gate || {}).flow, (flow) => editor.change((content) => {
    const name = named(content);
    content.gates = (content.gates || []).filter((one) => one.door !== name);
    if (flow > 0) content.gates.push({ ...gate, door: name, flow });
  }), { min: 0.01, placeholder: "any", id: "flow" })));
  if (event) rows.push(field("at, s", numberInput(event.at, (value) => set(state, value), { min: 0 })));
  return rows;
}

function rangeFields(editor, label, one, key, usual) {
  const given = one[key];
  const range = Array.isArray(given) ? given : given === undefined ? [undefined, undefined] : [given, given];
  if (typeof range[0] === "object") return [field(label, element("span", { textContent: "as the file has it" }))];
  const set = (k) => (value) => editor.act(() => editor.project.change((content) => {
    if (!content.population && !content.cohorts) content.population = one;
    const next = [...range];
    next[k] = value;
    if (next[0] === undefined) next[0] = next[1];
    if (next[1] === undefined || (k === 0 && next[1] < next[0])) next[1] = next[0];
    if (value === undefined) delete one[key];
    else one[key] = next[0] === next[1] ? next[0] : next;
  }));
  const inputs = [0, 1].map((k) => numberInput(range[k], set(k), { placeholder: usual[k], min: 0, aria: { "aria-label": `${label}, ${k ? "most" : "least"}` } }));
  return [field(label, element("span", { className: "pair" }, [inputs[0], "to", inputs[1]]))];
}

// The fields of people of one kind; `one` is a table of the project.
function fieldsOfPeople(editor, one) {
  const by = (set) => (value) => editor.act(() => editor.project.change((content) => {
    set(value);
    if (!content.population && !content.cohorts) content.population = one;
  }));
  const rows = [];
  if (!one.starts) rows.push(field("People", numberInput(one.people, by((value) => {
    one.people = value;
    if (value !== undefined) delete one.density;
  }), { min: 1, step: 1, id: `people-${one.start_region || ""}` })), field("or people per m²", numberInput(one.density, by((value) => {
    one.density = value;
    if (value !== undefined) delete one.people;
    else one.people ||= 20;
  }), { min: 0.01 })));
  rows.push(field("Profile", choice([["", "by speed"], ...editor.about.profiles], one.profile || "", by((value) => {
    one.profile = value || undefined;
    if (value) delete one.desired_speed;
    else delete one.profile;
  }))));
  if (!one.profile) rows.push(...rangeFields(editor, "Walking speed, m/s", one, "desired_speed", ["1.2", "1.4"]));
  rows.push(...rangeFields(editor, "Pre-movement time, s", one, "response_time", ["0", "0"]));
  const exits = Object.keys(editor.project.table("exits"));
  if (exits.length > 1) rows.push(field("Exits", choice([["", "any"], ...exits.map((name) => [name, `${name} alone`])],
    (one.exits || []).length === 1 ? one.exits[0] : "", by((value) => {
      if (value) one.exits = [value];
      else delete one.exits;
    }))));
  return rows;
}

function showElements(editor) {
  const { project, selected } = editor;
  const rows = project.elements().map((one, k) => {
    const lines = project.shape(one.kind, one.name);
    const name = typeof one.name === "string" ? one.name : `${KINDS[one.kind].word} ${one.name + 1}`;
    const chosen = selected && selected.kind === one.kind && selected.name === one.name;
    return element("div", { className: "row" }, [
      element("span", { className: "mark", style: `background: var(--${COLOR_OF[one.kind]})` }),
      button(name, () => editor.select(one), { className: "name", id: `element-${k}`, aria: { "aria-pressed": String(Boolean(chosen)) } }),
      element("span", { className: "what", textContent: `${KINDS[one.kind].word}, ${sizeOf(one.kind, lines)}` }),
    ]);
  });
  byId("elements").replaceChildren(...(rows.length ? rows : [element("p", { className: "quiet", textContent: "None yet: choose a tool, then click on the plan." })]));
}

function showPeople(editor) {
  const { project } = editor;
  const { population, cohorts } = project.content;
  const shared = population || {};
  const manners = [["", "hurried, as usual"], ...editor.about.walking.filter((one) => one !== "hurried").map((one) => [one, one])];
  const manner = typeof (project.content.manner ?? "") === "string" ? project.content.manner || "" : "";
  const rows = cohorts || shared.start_region ? [element("p", { className: "quiet", textContent: "People start in areas: select one to say how many." })] : [];
  if (!cohorts && !shared.start_region) rows.push(...fieldsOfPeople(editor, shared));
  rows.push(field("Walking", choice(manners, manner, (value) => editor.change((content) => (content.manner = value || undefined)))));
  rows.push(field("Time limit, s", numberInput(project.content.time_limit, (value) => editor.change((content) => (content.time_limit = value)), { min: 1, placeholder: "by size" })));
  byId("people").replaceChildren(...rows);
}

function showLayers(editor) {
  const { project } = editor;
  const { layers = [], levels = [] } = project.shown;
  const { file, level, unit } = project.geometry;
  byId("layers-of").hidden = !file;
  const roles = Object.entries(ROLE_WORDS);
  const set = (key) => (value) => {
    editor.known = false; // it lies elsewhere
    editor.change((content) => (content.geometry[key] = value || undefined));
  };
  const how = [field("Unit", choice([["", "as it is read"], ...["m", "cm", "mm", "ft", "in"].map((one) => [one, one])], unit || "", set("unit")))];
  if (levels.length) how.unshift(field("Level", choice([["", "-"], ...levels.map((one) => [one, one])], String(level ?? ""), set("level"))));
  byId("layers").replaceChildren(...how, ...layers.map((layer, k) => element("div", { className: "row" }, [
    element("span", { className: "mark", style: `background: var(--${COLOR_OF_ROLE[layer.role] || "faint"})` }),
    button(layer.name, () => editor.select({ kind: "layer", name: layer.name }), { className: "name", title: layer.name }),
    element("span", { className: "what", textContent: `${layer.count}` }),
    choice(roles, project.roleOfLayer(layer.name), (role) => editor.act(() => project.giveRole(layer.name, role)), `What ${layer.name} is`, `layer-${k}`),
  ])));
}

function showNotes(editor) {
  const { shown } = editor.project;
  byId("notes").replaceChildren(
    element("ul", {}, (shown.notes || []).map((text) => placed(editor, text, "problem note"))),
    element("pre", { textContent: shown.text || JSON.stringify(editor.project.content, null, 2) }),
  );
}
