// The project: the content of a scenario file, what is changed in it, and the way back.

// Kind of element -> where it stands in the project, its name for people, and what its shape is.
const KINDS = {
  exit: { group: "exits", word: "exit" },
  door: { group: "doors", word: "door" },
  start: { group: "regions", word: "start area" },
  stairs: { group: "regions", word: "stairs" },
  region: { group: "regions", word: "area" },
  section: { group: "sections", word: "line to count at" },
  wall: { list: "thin_walls", word: "wall" },
  block: { list: "obstacles", word: "obstacle" },
};

const copyOf = (value) => JSON.parse(JSON.stringify(value));

class Project {
  constructor(content) {
    this.content = copyOf(content);
    this.content.geometry ||= {};
    this.before = [];
    this.after = [];
    this.shown = {}; // what the server understood last
    this.saved = JSON.stringify(this.content);
  }

  get geometry() {
    return this.content.geometry;
  }

  get changed() {
    return JSON.stringify(this.content) !== this.saved;
  }

  // Change the content by a function; one step of undo.
  change(by) {
    const now = JSON.stringify(this.content);
    by(this.content);
    tidy(this.content);
    if (JSON.stringify(this.content) === now) return false;
    this.before.push(now);
    this.after = [];
    return true;
  }

  undo() {
    return this.#step(this.before, this.after);
  }

  redo() {
    return this.#step(this.after, this.before);
  }

  #step(from, to) {
    if (!from.length) return false;
    to.push(JSON.stringify(this.content));
    this.content = JSON.parse(from.pop());
    return true;
  }

  // Name -> shape as the file has it; without a table of exits or regions it has those of its drawing.
  table(group) {
    const drawn = (this.shown.drawn || {})[group] || {};
    const own = tableOf(this.content, group);
    const names = (table) => Object.fromEntries(Object.keys(table).map((name) => [name, name]));
    if (group === "exits") return own || names(drawn);
    const taken = new Set(Object.values(own || {}).filter((shape) => typeof shape === "string"));
    const rest = Object.keys(drawn).filter((name) => !taken.has(name) && !Object.hasOwn(own || {}, name));
    return group === "regions" ? { ...Object.fromEntries(rest.map((name) => [name, name])), ...own } : own || {};
  }

  // The lines of an element, each as points [m].
  shape(kind, name) {
    const { group, list } = KINDS[kind];
    const given = list ? (this.geometry[list] || [])[name] : this.table(group)[name];
    const points = pointsOf(given);
    if (points) return [kind === "start" || kind === "stairs" || kind === "region" || kind === "block" ? closed(points) : points];
    const drawn = (this.shown.drawn || {})[group] || {};
    if (typeof given === "string" && drawn[given]) return drawn[given];
    const found = (this.shown[group] || {})[name];
    if (found) return found.lines || found;
    return typeof given === "string" && group === "doors" ? this.shape("exit", given) : [];
  }

  // All elements: kind and name, or place in a list.
  elements() {
    const found = Object.keys(this.table("exits")).map((name) => ({ kind: "exit", name }));
    for (const kind of ["door", "section"])
      found.push(...Object.keys(this.table(KINDS[kind].group)).map((name) => ({ kind, name })));
    for (const name of Object.keys(this.table("regions"))) found.push({ kind: this.kindOfRegion(name), name });
    for (const kind of ["wall", "block"]) {
      const list = this.geometry[KINDS[kind].list];
      if (Array.isArray(list)) list.forEach((_, name) => found.push({ kind, name }));
    }
    return found;
  }

  kindOfRegion(name) {
    if (this.cohortsAt(name).length) return "start";
    return (this.content.zones || []).some((one) => one.region === name) ? "stairs" : "region";
  }

  // The tables of people that start in a region.
  cohortsAt(name) {
    const { population, cohorts } = this.content;
    return [...(cohorts || []), ...(cohorts || !population ? [] : [population])].filter((one) => one.start_region === name);
  }

  newName(kind) {
    const word = { start: "start", stairs: "stairs", region: "area", exit: "exit", door: "door", section: "line" }[kind];
    const taken = new Set(["exits", "doors", "regions", "sections"].flatMap((group) => Object.keys(this.table(group))));
    for (let number = 1; ; number += 1) if (!taken.has(`${word}-${number}`)) return `${word}-${number}`;
  }

  // Add what was drawn; returns the element.
  add(kind, points) {
    const shape = points.map((point) => point.map(cm));
    const { group, list } = KINDS[kind];
    const name = list ? (this.geometry[list] || []).length : this.newName(kind);
    this.change((content) => {
      if (list) (content.geometry[list] ||= []).push(shape);
      else put(content, group, { ...this.own(group), [name]: shape });
      if (kind === "start") putPeople(content, name);
      if (kind === "stairs") (content.zones ||= []).push({ region: name, factor: 0.6 });
    });
    return { kind, name };
  }

  // Take out an element; returns the names of the routes that have gone with it.
  remove({ kind, name }) {
    const { group, list } = KINDS[kind];
    const routes = (this.content.routes || []).map((one) => one.name);
    this.change((content) => {
      if (list) content.geometry[list].splice(name, 1);
      else put(content, group, without(this.own(group), name));
      if (group === "regions") {
        const stay = (content.cohorts || []).filter((one) => one.start_region !== name);
        const gone = (content.cohorts || []).filter((one) => one.start_region === name);
        if (gone.length && !stay.length) content.population = { ...(content.population || {}), people: gone[0].people || 20 };
        content.cohorts = stay;
      }
      cut(content, group, name);
      for (const [door, to] of Object.entries(content.geometry.doors || {})) {
        if (group !== "exits" || to !== name) continue;
        delete content.geometry.doors[door];
        cut(content, "doors", door);
      }
    });
    return routes.filter((one) => !(this.content.routes || []).some((other) => other.name === one));
  }

  rename({ kind, name }, to) {
    const { group } = KINDS[kind];
    const table = this.table(group);
    if (!to || to === name || Object.hasOwn(table, to)) return false;
    const swap = (one) => (one === name ? to : one);
    return this.change((content) => {
      const own = this.own(group);
      const all = Object.hasOwn(own, name) ? own : { ...own, [name]: name };
      put(content, group, Object.fromEntries(Object.entries(all).map(([key, shape]) => [swap(key), shape])));
      for (const [one, key] of ties(content, group)) one[key] = Array.isArray(one[key]) ? one[key].map(swap) : swap(one[key]);
      for (const [door, shape] of Object.entries(content.geometry.doors || {}))
        if (group === "exits") content.geometry.doors[door] = swap(shape);
    });
  }

  // Give an element other points; its name may be that of a shape of the drawing until then.
  reshape({ kind, name }, points) {
    const shape = points.map((point) => point.map(cm));
    const { group, list } = KINDS[kind];
    return this.change((content) => {
      if (list) content.geometry[list][name] = shape;
      else put(content, group, { ...this.own(group), [name]: shape });
    });
  }

  // The table of a group as the file will have it: once one exit is changed, all exits stand there.
  own(group) {
    return group === "exits" ? this.table("exits") : tableOf(this.content, group) || {};
  }

  // The points of an element that can be dragged: those of one line.
  handles({ kind, name }) {
    const lines = this.shape(kind, name);
    if (lines.length !== 1) return [];
    const [points] = lines;
    if (points.length > 30) return [];
    const ring = points.length > 3 && String(points[0]) === String(points.at(-1));
    return ring ? points.slice(0, -1) : points;
  }

  roleOfLayer(name) {
    const pattern = escaped(name);
    return Object.entries(this.geometry.layers || {}).find(([, names]) => names.includes(pattern))?.[0] || "";
  }

  giveRole(name, role) {
    const pattern = escaped(name);
    return this.change((content) => {
      const layers = content.geometry.layers || {};
      for (const names of Object.values(layers)) if (names.includes(pattern)) names.splice(names.indexOf(pattern), 1);
      if (role) (layers[role] ||= []).push(pattern);
      content.geometry.layers = Object.fromEntries(Object.entries(layers).filter(([, names]) => names.length));
    });
  }
}

// What holds the name of an exit, a region or a door: [table, key], whose value is a name or a list of names.
function ties(content, group) {
  const of = { exits: ["exits", "route"], regions: ["start_region"], routes: ["route"] }[group] || [];
  const more = {
    exits: [["routes", "exits"], ["rules", "route"], ["door_events", "exit"]],
    regions: [["zones", "region"], ["routes", "via"], ["rules", "region"], ["door_events", "region"]],
    doors: [["door_events", "door"], ["one_way", "door"], ["gates", "door"]],
    routes: [["rules", "route"]],
  }[group] || [];
  const found = peopleOf(content).flatMap((one) => of.map((key) => [one, key]));
  found.push(...more.flatMap(([list, key]) => (content[list] || []).map((one) => [one, key])));
  if (group === "doors") found.push([content, "closed_doors"]);
  if (group === "exits" || group === "routes") found.push([content, "strategy"]);
  return found.filter(([one, key]) => one[key] !== undefined);
}

// Take out what holds a name: from lists of names the name, from the lists of the file the whole entry.
function cut(content, group, name) {
  for (const [one, key] of ties(content, group)) {
    if (Array.isArray(one[key])) one[key] = one[key].filter((other) => other !== name);
    else if (one[key] === name) {
      const route = (content.routes || []).includes(one);
      delete one[key];
      for (const list of ["zones", "routes", "rules", "door_events", "one_way", "gates"])
        if (content[list]) content[list] = content[list].filter((other) => other !== one);
      if (route) cut(content, "routes", one.name); // people with that route choose among all exits
    }
  }
}

// Sections are a list in the file; here they are a table like all others.
function tableOf(content, group) {
  if (group !== "sections") return content.geometry[group];
  return Object.fromEntries((content.sections || []).map(({ name, line }) => [name, line]));
}

function put(content, group, table) {
  if (group === "sections") content.sections = Object.entries(table).map(([name, line]) => ({ name, line }));
  else content.geometry[group] = table;
}

const cm = (number) => Math.round(number * 1000) / 1000;
const without = (table, name) => Object.fromEntries(Object.entries(table).filter(([key]) => key !== name));
const escaped = (name) => name.replace(/[*?[]/g, "[$&]");
const peopleOf = (content) => [...(content.cohorts || []), ...(content.population ? [content.population] : [])];

function closed(points) {
  return String(points[0]) === String(points.at(-1)) ? points : [...points, points[0]];
}

function pointsOf(shape) {
  if (Array.isArray(shape) && Array.isArray(shape[0]) && typeof shape[0][0] === "number") return shape;
  if (shape && shape.box) {
    const [x0, y0, x1, y1] = shape.box;
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]];
  }
  if (shape && shape.circle) {
    const [x, y, radius] = shape.circle;
    const angles = Array.from({ length: 33 }, (_, k) => (Math.PI * k) / 16);
    return angles.map((angle) => [x + radius * Math.cos(angle), y + radius * Math.sin(angle)]);
  }
  return null;
}

// People in a new start area: the first one takes all people there are, later ones have 20.
function putPeople(content, region) {
  const { population = {}, cohorts } = content;
  if (cohorts && cohorts.length) cohorts.push({ people: 20, start_region: region });
  else if (population.start_region) {
    const { people, density, start_region, exits, ...shared } = population;
    content.cohorts = [{ people, density, start_region, exits }, { people: 20, start_region: region }];
    content.population = shared;
  } else content.population = { ...population, people: population.people || 20, start_region: region };
}

// Take out what is empty, so that a file holds nothing without a meaning.
function tidy(content) {
  const empty = (value) => value === undefined || value === null || (typeof value === "object" && !Object.keys(value).length);
  // Without a table of exits those of the drawing would come back.
  const kept = (table, key) => key === "population" || key === "geometry" || (key === "exits" && table === content.geometry);
  for (const table of [content.geometry, content, ...peopleOf(content)])
    for (const key of Object.keys(table)) if (empty(table[key]) && !kept(table, key)) delete table[key];
  // One cohort is a population.
  if (content.cohorts && content.cohorts.length === 1) {
    content.population = { ...(content.population || {}), ...content.cohorts[0] };
    delete content.cohorts;
  }
}
