// Where a point that is drawn comes to lie: at a corner, on an edge, or on a fine raster.

const NEAR = 11; // px
const RASTER = 0.05; // m

class Snapper {
  constructor() {
    this.corners = new Float64Array(0);
    this.edges = new Float64Array(0); // ax, ay, bx, by
  }

  // Take lines, each as points.
  take(lines) {
    const corners = [];
    const edges = [];
    for (const line of lines) {
      line.forEach(([x, y], k) => {
        corners.push(x, y);
        if (k) edges.push(...line[k - 1], x, y);
      });
    }
    this.corners = Float64Array.from(corners);
    this.edges = Float64Array.from(edges);
  }

  // Return the point near (x, y) [m], and what it is: "corner", "edge" or "".
  at(x, y, scale, free) {
    if (free) return { x: cm(x), y: cm(y), what: "" };
    let best = (NEAR / scale) ** 2;
    let found = null;
    for (let k = 0; k < this.corners.length; k += 2) {
      const [cx, cy] = [this.corners[k], this.corners[k + 1]];
      const apart = (cx - x) ** 2 + (cy - y) ** 2;
      if (apart < best) [best, found] = [apart, { x: cx, y: cy, what: "corner" }];
    }
    if (found) return found;
    best = (NEAR / scale) ** 2;
    for (let k = 0; k < this.edges.length; k += 4) {
      const [ax, ay, bx, by] = this.edges.subarray(k, k + 4);
      const [dx, dy] = [bx - ax, by - ay];
      const along = Math.min(Math.max(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1), 0), 1);
      const [px, py] = [ax + along * dx, ay + along * dy];
      const apart = (px - x) ** 2 + (py - y) ** 2;
      if (apart < best) [best, found] = [apart, { x: px, y: py, what: "edge", edge: [ax, ay, bx, by], along }];
    }
    if (found) return onRaster(found);
    const step = RASTER * scale > 2 ? RASTER : 0.1;
    return { x: cm(Math.round(x / step) * step), y: cm(Math.round(y / step) * step), what: "" };
  }
}

// A point on an edge keeps a distance from its beginning that is a multiple of 5 cm, unless the edge is too short for that.
function onRaster(found) {
  const [ax, ay, bx, by] = found.edge;
  const length = Math.hypot(bx - ax, by - ay);
  const from = Math.round((found.along * length) / RASTER) * RASTER;
  if (from > length) return found;
  return { ...found, x: ax + ((bx - ax) * from) / length, y: ay + ((by - ay) * from) / length };
}
