// What lies on the canvas: the floor as it was understood, the layers of the drawing, and what is being drawn.

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const COLOR_OF = { exit: "exit", door: "door", section: "accent", start: "start", stairs: "region", region: "region", wall: "ink", block: "quiet" };
const COLOR_OF_ROLE = {
  walkable: "accent", obstacle: "ink", room: "accent", stairs: "region", exit: "exit", door: "door", start: "start", region: "region",
};
const AREAS = ["start", "stairs", "region", "block"];

function drawPicture(context, view, editor) {
  const { project, selected } = editor;
  const shown = project.shown;
  const color = (name) => css(name) || "#888";
  view.labels = []; // where there is text already
  context.setTransform(view.ratio, 0, 0, view.ratio, 0, 0);
  context.fillStyle = color("background");
  context.fillRect(0, 0, view.width, view.height);
  context.lineJoin = "round";
  if (shown.floor) {
    const floor = ringsPath([...shown.floor.shells, ...shown.floor.holes], view);
    context.fillStyle = color("obstacle");
    context.fill(ringsPath(shown.floor.holes, view));
    context.fillStyle = color("floor");
    context.fill(floor, "evenodd");
    context.strokeStyle = color("wall");
    context.lineWidth = 1.5;
    context.stroke(floor);
    context.fillStyle = context.strokeStyle = color("bad");
    for (const part of shown.lost || []) hatch(context, ringsPath(part, view), view);
  }
  for (const layer of shown.layers || []) drawLayer(context, view, layer, selected, color);
  drawElements(context, view, editor, color);
  drawPeople(context, view, shown, color);
  for (const { line, width } of shown.narrow || []) {
    drawLines(context, view, [line], color("bad"), 2, [3, 3]);
    const [x, y] = middleOf(line);
    write(context, view, `${width.toFixed(2)} m`, view.px(x), view.py(y) - 8, color("bad"), color("background"));
  }
  for (const [x, y] of editor.marks) ringAt(context, view.px(x), view.py(y), 14, color("bad"), 3);
  drawDraft(context, view, editor, color);
  drawScaleBar(context, view, { background: color("background"), quiet: color("quiet"), font: css("font") });
}

function drawLayer(context, view, layer, selected, color) {
  const chosen = selected && selected.kind === "layer" && selected.name === layer.name;
  const of = COLOR_OF_ROLE[layer.role];
  context.strokeStyle = color(chosen ? "accent" : of || "quiet");
  context.lineWidth = chosen ? 3 : of ? 1 : 0.7;
  context.globalAlpha = chosen || of ? 0.9 : 0.6;
  const path = new Path2D();
  for (const line of layer.shapes.flat()) {
    line.forEach(([x, y], k) => (k ? path.lineTo(view.px(x), view.py(y)) : path.moveTo(view.px(x), view.py(y))));
    if (line.length === 1) path.arc(view.px(line[0][0]), view.py(line[0][1]), 3, 0, 7);
  }
  context.stroke(path);
  context.globalAlpha = 1;
}

function drawElements(context, view, editor, color) {
  const { project, selected } = editor;
  for (const one of project.elements()) {
    const lines = project.shape(one.kind, one.name);
    if (!lines.length) continue;
    const chosen = selected && selected.kind === one.kind && selected.name === one.name;
    const paint = color(COLOR_OF[one.kind]);
    if (AREAS.includes(one.kind)) {
      context.globalAlpha = chosen ? 0.35 : 0.16;
      context.fillStyle = paint;
      context.fill(ringsPath(lines, view), "evenodd");
      context.globalAlpha = 1;
    }
    const wide = { exit: 4, door: 3, wall: 2 }[one.kind] || 1.5;
    drawLines(context, view, lines, paint, chosen ? wide + 2 : wide, one.kind === "door" || one.kind === "section" ? [6, 4] : []);
    if (typeof one.name === "string") {
      const [x, y] = AREAS.includes(one.kind) ? centerOf(lines[0]) : middleOf(lines[0]);
      const name = one.name.length > 28 ? `${one.name.slice(0, 27)}…` : one.name;
      write(context, view, name, view.px(x), view.py(y) - (one.kind === "exit" ? 10 : 0), paint, color("background"));
    }
    if (chosen)
      for (const [x, y] of project.handles(one)) {
        context.fillStyle = color("background");
        context.strokeStyle = paint;
        context.lineWidth = 2;
        context.fillRect(view.px(x) - 5, view.py(y) - 5, 10, 10);
        context.strokeRect(view.px(x) - 5, view.py(y) - 5, 10, 10);
      }
  }
}

function drawPeople(context, view, shown, color) {
  const path = new Path2D();
  for (const [x, y, r] of shown.people || []) {
    const [px, py] = [view.px(x), view.py(y)];
    path.moveTo(px + r * view.scale, py);
    path.arc(px, py, Math.max(r * view.scale, 1), 0, 7);
  }
  context.fillStyle = color("people");
  context.globalAlpha = 0.75;
  context.fill(path);
  context.globalAlpha = 1;
}

function drawDraft(context, view, editor, color) {
  const { draft, pointer, tool } = editor;
  const paint = color(COLOR_OF[tool] || "accent");
  const points = pointer && tool !== "select" ? [...draft, [pointer.x, pointer.y]] : draft;
  if (draft.length) {
    const box = AREAS.includes(tool) && draft.length === 1 && pointer;
    const line = box ? rectangleOf(draft[0], [pointer.x, pointer.y]) : points;
    drawLines(context, view, [line], paint, 2, [5, 4]);
    for (const [x, y] of draft) ringAt(context, view.px(x), view.py(y), 4, paint, 2);
  }
  if (!pointer || tool === "select") return;
  const [px, py] = [view.px(pointer.x), view.py(pointer.y)];
  context.strokeStyle = paint;
  context.lineWidth = 1;
  context.beginPath();
  context.moveTo(px - 12, py);
  context.lineTo(px + 12, py);
  context.moveTo(px, py - 12);
  context.lineTo(px, py + 12);
  context.stroke();
  if (pointer.what === "corner") context.strokeRect(px - 6, py - 6, 12, 12);
  if (pointer.what === "edge") ringAt(context, px, py, 6, paint, 1.5);
}

function drawLines(context, view, lines, color, width, dash = []) {
  context.strokeStyle = color;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.beginPath();
  for (const line of lines)
    line.forEach(([x, y], k) => (k ? context.lineTo(view.px(x), view.py(y)) : context.moveTo(view.px(x), view.py(y))));
  context.stroke();
  context.setLineDash([]);
}

function hatch(context, path, view) {
  context.save();
  context.clip(path, "evenodd");
  context.globalAlpha = 0.5;
  context.beginPath();
  for (let x = -view.height; x < view.width; x += 9) {
    context.moveTo(x, view.height);
    context.lineTo(x + view.height, 0);
  }
  context.lineWidth = 1.5;
  context.stroke();
  context.restore();
}

function ringAt(context, x, y, radius, color, width) {
  context.strokeStyle = color;
  context.lineWidth = width;
  context.beginPath();
  context.arc(x, y, radius, 0, 7);
  context.stroke();
}

// Text around a place [px], moved into the picture and off what is written already.
function write(context, view, text, x, y, color, behind) {
  if (x < 0 || x > view.width || y < 0 || y > view.height) return;
  context.font = `600 12px ${css("font")}`;
  const wide = context.measureText(text).width + 8;
  const way = y > view.height / 2 ? -15 : 15;
  x = Math.max(wide / 2, Math.min(x, view.width - wide / 2));
  while (view.labels.some((other) => Math.abs(other.x - x) < (other.wide + wide) / 2 && Math.abs(other.y - y) < 15)) y += way;
  view.labels.push({ x, y, wide });
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.lineWidth = 4;
  context.strokeStyle = behind;
  context.strokeText(text, x, y);
  context.fillStyle = color;
  context.fillText(text, x, y);
  context.textAlign = "left";
}

const rectangleOf = ([ax, ay], [bx, by]) => [[ax, ay], [bx, ay], [bx, by], [ax, by], [ax, ay]];
const lengthOf = (line) => line.reduce((sum, [x, y], k) => (k ? sum + Math.hypot(x - line[k - 1][0], y - line[k - 1][1]) : 0), 0);

function middleOf(line) {
  let rest = lengthOf(line) / 2;
  for (let k = 1; k < line.length; k += 1) {
    const [[ax, ay], [bx, by]] = [line[k - 1], line[k]];
    const length = Math.hypot(bx - ax, by - ay);
    if (rest <= length) return [ax + ((bx - ax) * rest) / (length || 1), ay + ((by - ay) * rest) / (length || 1)];
    rest -= length;
  }
  return line[0];
}

function areaOf(ring) {
  return Math.abs(ring.reduce((sum, [x, y], k) => (k ? sum + ring[k - 1][0] * y - x * ring[k - 1][1] : 0), 0)) / 2;
}

function centerOf(ring) {
  const points = ring.slice(0, -1);
  return [0, 1].map((k) => points.reduce((sum, point) => sum + point[k], 0) / points.length);
}

function inside(ring, x, y) {
  let found = false;
  for (let k = 1; k < ring.length; k += 1) {
    const [[ax, ay], [bx, by]] = [ring[k - 1], ring[k]];
    if (ay > y !== by > y && x < ax + ((bx - ax) * (y - ay)) / (by - ay)) found = !found;
  }
  return found;
}

function distanceTo(line, x, y) {
  let best = Infinity;
  line.forEach(([bx, by], k) => {
    const [ax, ay] = line[Math.max(k - 1, 0)];
    const [dx, dy] = [bx - ax, by - ay];
    const along = Math.min(Math.max(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1), 0), 1);
    best = Math.min(best, Math.hypot(ax + along * dx - x, ay + along * dy - y));
  });
  return best;
}
