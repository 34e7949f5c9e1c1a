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
  context.setTransform(view.ratio, 0, 0, view.ratio, 0, 0);
  context.fillStyle = theme.background;
  context.fillRect(0, 0, view.width, view.height);
  const floor = ringsPath([...plan.shells, ...plan.holes], view);
  const wall = Math.max(WALL_THICKNESS * scale, 1.5);
  context.lineJoin = "miter";
  context.lineCap = "butt";
  context.fillStyle = theme.obstacle;
  context.fill(ringsPath(plan.holes, view));
  context.strokeStyle = theme.wall;
  context.lineWidth = 2 * wall;
  context.stroke(floor);
  context.fillStyle = theme.mat;
  for (const { ends } of plan.exits) context.fill(matPath(ends, view, (wall + Math.min(0.35 * scale, 14)) / scale));
  context.fillStyle = theme.floor;
  context.fill(floor, "evenodd");
  drawZones(context, plan.zones, view, theme, floor);
  context.lineCap = "round";
  context.lineWidth = Math.max(0.06 * scale, 2);
  context.strokeStyle = theme.wall;
  context.stroke(linesPath(plan.thin_walls, view));
  context.setLineDash([4, 4]);
  context.strokeStyle = theme.quiet;
  context.stroke(linesPath(plan.doors, view));
  context.setLineDash([]);
  context.lineCap = "butt";
  context.strokeStyle = theme.exit;
  context.lineWidth = Math.min(Math.max(0.35 * wall, 2), 4);
  context.stroke(linesPath(plan.exits.map(({ ends }) => ends), view));
  drawScaleBar(context, view, theme);
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
