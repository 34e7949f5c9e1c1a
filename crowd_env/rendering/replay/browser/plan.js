// The still part of a picture: floor, zones, walls, obstacles, doors and exits; y of meters points up, y of pixels down.

const WALL_THICKNESS = 0.11; // m, as drawn; walls of the model have none

function ringsPath(rings, view) {
  const path = new Path2D();
  for (const ring of rings) {
    ring.forEach(([x, y], k) => {
      if (k) path.lineTo(view.px(x), view.py(y));
      else path.moveTo(view.px(x), view.py(y));
    });
    path.closePath();
  }
  return path;
}

function linesPath(segments, view) {
  const path = new Path2D();
  for (const [[ax, ay], [bx, by]] of segments) {
    path.moveTo(view.px(ax), view.py(ay));
    path.lineTo(view.px(bx), view.py(by));
  }
  return path;
}

// The strip outside of an exit, whose inside is to the left.
function matPath(ends, view, depth) {
  const [[ax, ay], [bx, by]] = ends;
  const length = Math.hypot(bx - ax, by - ay) || 1;
  const nx = ((by - ay) / length) * depth;
  const ny = (-(bx - ax) / length) * depth;
  return ringsPath([[[ax, ay], [bx, by], [bx + nx, by + ny], [ax + nx, ay + ny]]], view);
}

function drawPlan(context, recording, view, theme) {
  const { plan } = recording;
  const scale = view.scale;
  context.fillStyle = theme.background;
  context.fillRect(0, 0, view.width, view.height);
  const wall = Math.max(WALL_THICKNESS * scale, 1.5);
  context.lineJoin = "miter";
  for (const part of plan.parts ?? [plan]) {
    const floor = ringsPath([...part.shells, ...part.holes], view);
    context.lineCap = "butt";
    context.fillStyle = theme.obstacle;
    context.fill(ringsPath(part.holes, view));
    context.strokeStyle = theme.wall;
    context.lineWidth = 2 * wall;
    context.stroke(floor);
    if (part === plan) drawMats(context, plan, view, theme, wall);
    context.fillStyle = theme.floor;
    context.fill(floor, "evenodd");
    if (part === plan) drawZones(context, plan.zones, view, theme, floor);
    context.lineCap = "round";
    context.lineWidth = Math.max(0.06 * scale, 2);
    context.stroke(linesPath(part.thin_walls, view));
  }
  context.lineCap = "butt";
  context.strokeStyle = theme.seam;
  context.lineWidth = Math.min(Math.max(wall, 3), 8);
  context.stroke(linesPath((plan.seams ?? []).map(({ ends }) => ends), view));
  context.setLineDash([4, 4]);
  context.strokeStyle = theme.quiet;
  context.stroke(linesPath(plan.doors, view));
  context.setLineDash([]);
  context.lineCap = "butt";
  context.strokeStyle = theme.exit;
  context.lineWidth = Math.min(Math.max(0.35 * wall, 2), 4);
  context.stroke(linesPath(plan.exits.map(({ ends }) => ends), view));
  drawNames(context, plan, view, theme);
  if (!plan.parts) drawScaleBar(context, view, theme);
}

function drawMats(context, plan, view, theme, wall) {
  context.fillStyle = theme.mat;
  for (const { ends } of plan.exits) context.fill(matPath(ends, view, (wall + Math.min(0.35 * view.scale, 14)) / view.scale));
}

// Of a building: the names of storeys below their lower left corners, and at each seam a letter, the same at both of its ends.
function drawNames(context, plan, view, theme) {
  context.textBaseline = "middle";
  context.textAlign = "left";
  context.font = `12px ${theme.font}`;
  context.strokeStyle = theme.background;
  context.lineWidth = 4;
  context.lineJoin = "round";
  for (const { name, box, shells } of plan.storeys ?? plan.parts ?? []) {
    const [x, y] = box ?? shells.flat().reduce((a, b) => (b[0] < a[0] ? b : a));
    // A stair without room for its name has letters that say where it leads.
    if (box && context.measureText(name).width > (box[2] - box[0] + 2 * AROUND) * view.scale - 4) continue;
    context.strokeText(name, view.px(x), view.py(y) + 13);
    context.fillStyle = theme.quiet;
    context.fillText(name, view.px(x), view.py(y) + 13);
  }
  context.textAlign = "center";
  context.fillStyle = theme.ink;
  context.font = `600 12px ${theme.font}`;
  for (const { letter, ends: [[ax, ay], [bx, by]] } of plan.seams ?? []) {
    const length = Math.hypot(bx - ax, by - ay) || 1;
    const [x, y] = [view.px((ax + bx) / 2) + (11 * (by - ay)) / length, view.py((ay + by) / 2) + (11 * (bx - ax)) / length];
    if (letter) context.fillText(letter, x, y);
  }
}

// Where people walk at another speed, such as stairs: tinted and framed, as on the picture of the plan.
function drawZones(context, zones, view, theme, floor) {
  context.save();
  context.clip(floor, "evenodd");
  context.setLineDash([4, 2]);
  context.lineWidth = 1;
  context.font = `12px ${theme.font}`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillStyle = context.strokeStyle = theme.zone;
  for (const { name, rings } of zones) {
    const area = ringsPath(rings, view);
    context.globalAlpha = 0.15;
    context.fill(area, "evenodd");
    context.globalAlpha = 0.75;
    context.stroke(area);
    const [x, y] = [0, 1].map((axis) => rings[0].map((point) => point[axis]));
    const [[left, right], [low, high]] = [x, y].map((all) => [Math.min(...all), Math.max(...all)]);
    context.globalAlpha = 1;
    if (context.measureText(name).width < view.scale * (right - left)) {
      context.fillText(name, view.px((left + right) / 2), view.py((low + high) / 2));
    }
  }
  context.restore();
}

function drawScaleBar(context, view, theme) {
  const most = Math.min(0.25 * view.width, 110) / view.scale;
  const power = 10 ** Math.floor(Math.log10(most));
  const length = [5, 2, 1].map((step) => step * power).find((step) => step <= most);
  const [left, base] = [14.5, view.height - 8.5];
  const right = left + length * view.scale;
  const text = `${Number(length.toPrecision(1))} m`;
  context.font = `12px ${theme.font}`;
  context.beginPath();
  context.moveTo(left, base - 4);
  context.lineTo(left, base);
  context.lineTo(right, base);
  context.lineTo(right, base - 4);
  context.textAlign = "left";
  context.textBaseline = "alphabetic";
  context.lineJoin = "round";
  for (const [color, width] of [[theme.background, 4], [theme.quiet, 1]]) {
    context.strokeStyle = context.fillStyle = color; // first a wide line around all, in case something lies below
    context.lineWidth = width;
    context.stroke();
    if (width > 1) context.strokeText(text, right + 6, base);
    context.fillText(text, right + 6, base);
  }
}
