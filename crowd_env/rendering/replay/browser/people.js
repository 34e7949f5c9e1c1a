// People at one moment, color by color; forces as lines as wide as the force; names and counts of exits; the person chosen.

const DOT = 1.6; // px, radius below which people are squares without a rim
const FORCE_STEPS = 12; // widths of lines

// Order `recording.who` by color: rows of one color lie side by side.
function sortByColor(recording, coloring, colors) {
  const { who, shown } = recording;
  const count = new Int32Array(colors + 2); // the last color is "unknown"
  const number = (recording.number ??= new Int16Array(recording.people));
  for (let k = 0; k < shown; k++) {
    const n = who[k];
    const color = coloring.number(recording, n);
    number[n] = color < 0 ? colors : color;
    count[number[n] + 1]++;
  }
  for (let c = 0; c <= colors; c++) count[c + 1] += count[c];
  const sorted = (recording.sorted ??= new Int32Array(recording.people));
  const next = count.slice();
  for (let k = 0; k < shown; k++) sorted[next[number[who[k]]]++] = who[k];
  return { sorted, count };
}

function drawPeople(context, recording, view, theme, coloring, colors, options) {
  const { fill, rim } = colors[coloring.key];
  const { sorted, count } = sortByColor(recording, coloring, fill.length);
  const put = recording.about.outline ? putBodies : putDiscs;
  for (let c = 0; c <= fill.length; c++) {
    if (count[c] === count[c + 1]) continue;
    const known = c < fill.length;
    context.fillStyle = known ? fill[c] : colors.unknown.fill[0];
    context.strokeStyle = theme.rim || (known ? rim[c] : colors.unknown.rim[0]);
    put(context, recording, view, sorted, count[c], count[c + 1]);
  }
  if (view.scale * recording.typicalRadius > 5) drawHeadings(context, recording, view, theme);
  if (options.forces) drawForces(context, recording, view, theme, options.fullForce);
  if (options.chosen >= 0) drawChosen(context, recording, view, theme, options.chosen);
}

function putDiscs(context, recording, view, rows, from, to) {
  const { px, py, radius } = recording;
  const { scale, left, top } = view;
  const turn = 2 * Math.PI;
  const typical = scale * recording.typicalRadius;
  if (typical < DOT) {
    for (let k = from; k < to; k++) {
      const n = rows[k];
      const r = Math.max(scale * radius[n], 0.6);
      context.fillRect(left + scale * px[n] - r, top - scale * py[n] - r, 2 * r, 2 * r);
    }
    return;
  }
  const edge = typical > 3 ? Math.min(Math.max(0.075 * typical, 0.7), 3) : 0;
  context.lineWidth = edge;
  context.beginPath();
  for (let k = from; k < to; k++) {
    const n = rows[k];
    const x = left + scale * px[n];
    const y = top - scale * py[n];
    if (x < -99 || y < -99 || x > view.width + 99 || y > view.height + 99) continue;
    const r = Math.max(scale * radius[n] - 0.5 * edge, 0.5);
    context.moveTo(x + r, y);
    context.arc(x, y, r, 0, turn);
  }
  context.fill();
  if (edge) context.stroke();
}

// Bodies of several discs: all of it in the color of the rim, then smaller discs in their color.
function putBodies(context, recording, view, rows, from, to) {
  const { px, py, radius, nowAngle } = recording;
  const discs = recording.about.outline;
  const { scale, left, top } = view;
  const color = context.fillStyle;
  const typical = scale * recording.typicalRadius;
  const edge = typical > 3 ? Math.min(Math.max(0.09 * typical, 0.7), 3) : 0;
  for (const less of edge ? [0, edge] : [0]) {
    context.fillStyle = edge && !less ? context.strokeStyle : color;
    context.beginPath();
    for (let k = from; k < to; k++) {
      const n = rows[k];
      const size = scale * radius[n];
      const cosine = size * Math.cos(nowAngle[n]);
      const sine = size * Math.sin(nowAngle[n]);
      const x = left + scale * px[n];
      const y = top - scale * py[n];
      if (x < -99 || y < -99 || x > view.width + 99 || y > view.height + 99) continue;
      for (const [ahead, aside, share] of discs) {
        const cx = x + cosine * ahead - sine * aside;
        const cy = y - sine * ahead - cosine * aside;
        const r = Math.max(size * share - less, 0.4);
        context.moveTo(cx + r, cy);
        context.arc(cx, cy, r, 0, 2 * Math.PI);
      }
    }
    context.fill();
  }
}

// A short tick where each person is going, or facing.
function drawHeadings(context, recording, view, theme) {
  const { who, shown, px, py, radius, nowAngle, aheadX, aheadY } = recording;
  const { scale, left, top } = view;
  const turned = Boolean(recording.about.outline);
  context.strokeStyle = theme.tick;
  context.lineWidth = Math.min(Math.max(0.09 * scale * recording.typicalRadius, 1), 3);
  context.lineCap = "round";
  context.beginPath();
  for (let k = 0; k < shown; k++) {
    const n = who[k];
    const hx = turned ? Math.cos(nowAngle[n]) : aheadX[n];
    const hy = turned ? Math.sin(nowAngle[n]) : aheadY[n];
    if (!hx && !hy) continue;
    const r = scale * radius[n];
    const x = left + scale * px[n];
    const y = top - scale * py[n];
    const [near, far] = turned ? [0.22, 0.42] : [0.42, 0.82];
    context.moveTo(x + near * r * hx, y - near * r * hy);
    context.lineTo(x + far * r * hx, y - far * r * hy);
  }
  context.stroke();
}

// Width of the line of a force [px]; the full force is nearly as wide as a body.
function forceWidth(force, fullForce, recording, view) {
  return Math.min(force / fullForce, 1.5) * 0.9 * view.scale * recording.typicalRadius;
}

function drawForces(context, recording, view, theme, fullForce) {
  const { contact_start, contact_i, contact_j, contact_x, contact_y, contact_force } = recording;
  if (!contact_start) return;
  const { px, py, isShown, frame } = recording;
  const paths = Array.from({ length: FORCE_STEPS }, () => null);
  for (let k = contact_start[frame]; k < contact_start[frame + 1]; k++) {
    const i = contact_i[k];
    const j = contact_j[k];
    if (!isShown[i] || (j >= 0 ? !isShown[j] : recording.stacked)) continue;
    const part = Math.min(contact_force[k] / fullForce / 1.5, 1);
    const path = (paths[Math.min(Math.floor(part * FORCE_STEPS), FORCE_STEPS - 1)] ??= new Path2D());
    path.moveTo(view.px(px[i]), view.py(py[i]));
    path.lineTo(j < 0 ? view.px(contact_x[k]) : view.px(px[j]), j < 0 ? view.py(contact_y[k]) : view.py(py[j]));
  }
  context.strokeStyle = theme.force;
  context.lineCap = "round";
  paths.forEach((path, step) => {
    if (!path) return;
    context.lineWidth = Math.max(forceWidth(((step + 0.5) / FORCE_STEPS) * 1.5 * fullForce, fullForce, recording, view), 0.4);
    context.stroke(path);
  });
}

// How many are out by each exit; with the names of exits where there is room for all of them.
function drawExitNames(context, recording, view, theme) {
  if (recording.exits.length < 2 || recording.exits.length > 12) return;
  context.font = `600 12px ${theme.font}`;
  const places = recording.exits.flatMap(({ name, ends, times }) => {
    const [[ax, ay], [bx, by]] = ends[ends.length >> 1];
    const [x, y] = [view.px((ax + bx) / 2), view.py((ay + by) / 2)];
    if (x < 0 || y < 0 || x > view.width || y > view.height || !view.holds(ax, ay)) return [];
    const length = Math.hypot(bx - ax, by - ay) || 1;
    const count = lastNotAbove(times, recording.time) + 1;
    return [{ name, count, x, y, outX: (by - ay) / length, outY: (bx - ax) / length }];
  });
  const label = ({ x, y, outX, outY }, text) => {
    const wide = context.measureText(text).width + 10;
    return { text, wide, x: x + outX * (8 + wide / 2), y: y + outY * 17 };
  };
  const whole = places.map((place) => label(place, `${place.name} ${place.count}`));
  const fit = whole.every(({ x, wide }) => x >= wide / 2 && x <= view.width - wide / 2);
  const labels = fit ? whole : places.map((place) => label(place, `${place.count}`));
  context.textBaseline = "middle";
  context.textAlign = "center";
  for (const { text, wide, x: aside, y } of labels) {
    const x = Math.min(Math.max(aside, wide / 2), view.width - wide / 2);
    context.fillStyle = theme.mat;
    context.beginPath();
    context.roundRect(x - wide / 2, y - 9, wide, 18, 9);
    context.fill();
    context.fillStyle = theme.exitInk;
    context.fillText(text, x, y + 0.5);
  }
}

// The way of the chosen person so far and to come, and a ring.
function drawChosen(context, recording, view, theme, n) {
  const { start, x, y, px, py, radius, first, frame } = recording;
  const trail = (from, to) => {
    context.beginPath();
    for (let k = from; k < to; k++) {
      if (k > from && recording.leaps(k - 1, k)) context.moveTo(view.px(x[k]), view.py(y[k]));
      else context.lineTo(view.px(x[k]), view.py(y[k]));
    }
    context.stroke();
  };
  const now = Math.min(Math.max(start[n] + frame - first[n] + 1, start[n]), start[n + 1]);
  context.strokeStyle = theme.ink;
  context.lineWidth = 1.5;
  context.lineCap = context.lineJoin = "round";
  trail(start[n], now);
  context.globalAlpha = 0.35;
  trail(Math.max(now - 1, start[n]), start[n + 1]);
  context.globalAlpha = 1;
  if (!recording.isShown[n]) return;
  context.lineWidth = 2.5;
  context.beginPath();
  context.arc(view.px(px[n]), view.py(py[n]), view.scale * radius[n] + 4, 0, 2 * Math.PI);
  context.stroke();
}
