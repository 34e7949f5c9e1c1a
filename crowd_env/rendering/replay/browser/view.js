// Where meters lie on a canvas, and how fingers, mouse and wheel move that.

const MARGIN = 30; // px around the plan
const MARGIN_OF_NAMES = 84; // px beside it, where exits have names
const AROUND = 2.4; // m around a storey: less than half of what lies between two
const DEEPEST = 400; // px/m, or more where the whole plan is larger on the screen

class View {
  constructor(bounds, named) {
    this.bounds = bounds;
    this.named = named;
    this.ratio = 1;
    this.width = this.height = 1;
    this.scale = 1; // px/m
    this.left = this.top = 0; // px, where the origin lies
    this.fitted = true;
  }

  px(x) {
    return this.left + this.scale * x;
  }

  py(y) {
    return this.top - this.scale * y;
  }

  resize(width, height, ratio) {
    const [x, y] = [(this.width / 2 - this.left) / this.scale, (this.top - this.height / 2) / this.scale];
    Object.assign(this, { width, height, ratio });
    if (this.fitted) this.fit();
    else this.center(x, y, this.scale);
  }

  center(x, y, scale) {
    this.scale = scale;
    this.left = this.width / 2 - scale * x;
    this.top = this.height / 2 + scale * y;
  }

  fitScale() {
    const [x0, y0, x1, y1] = this.bounds;
    const margin = Math.min(MARGIN, 0.1 * Math.min(this.width, this.height));
    const beside = this.named ? Math.min(Math.max(0.1 * this.width, margin), MARGIN_OF_NAMES) : margin;
    const across = (this.width - 2 * beside) / Math.max(x1 - x0, 1e-3);
    return Math.max(Math.min(across, (this.height - 2 * margin) / Math.max(y1 - y0, 1e-3)), 1e-3);
  }

  fit() {
    const [x0, y0, x1, y1] = this.bounds;
    this.fitted = true;
    this.center((x0 + x1) / 2, (y0 + y1) / 2, this.fitScale());
  }

  zoom(factor, x, y) {
    const whole = this.fitScale();
    const scale = Math.min(Math.max(this.scale * factor, 0.5 * whole), Math.max(DEEPEST, 4 * whole));
    this.left = x + ((this.left - x) * scale) / this.scale;
    this.top = y + ((this.top - y) * scale) / this.scale;
    this.scale = scale;
    this.fitted = false;
  }

  pan(dx, dy) {
    this.left += dx;
    this.top += dy;
    this.fitted = false;
  }

  // Whether a place is on the storey that is shown, if one is.
  holds(x, y) {
    const [x0, y0, x1, y1] = this.box ?? [-Infinity, -Infinity, Infinity, Infinity];
    return x > x0 - AROUND && x < x1 + AROUND && y > y0 - AROUND && y < y1 + AROUND;
  }

  // Draw on a canvas that is empty, only what lies in the box of a storey if one is shown.
  within(canvas, draw) {
    const context = canvas.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.save();
    if (this.box) {
      const [x0, y0, x1, y1] = this.box;
      const [left, top, right, low] = [this.px(x0 - AROUND), this.py(y1 + AROUND), this.px(x1 + AROUND), this.py(y0 - AROUND)];
      context.beginPath();
      context.rect(left, top, right - left, low - top);
      context.clip();
    }
    draw(context);
    context.restore();
  }

  // Show what another view shows, on a canvas of another size.
  follow(other) {
    const x = (other.width / 2 - other.left) / other.scale;
    const y = (other.top - other.height / 2) / other.scale;
    if (other.fitted) this.fit();
    else {
      this.fitted = false;
      this.center(x, y, (other.scale * this.fitScale()) / other.fitScale());
    }
  }
}

// Drag pans, wheel and pinch zoom, a double click shows all unless it means something else, a click without a drag chooses.
function listenToView(canvas, view, { changed, clicked, twice }) {
  const pointers = new Map();
  let moved = 0;
  let lastClick = { time: -1e9, x: 0, y: 0 };

  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  };
  const middle = () => {
    const all = [...pointers.values()];
    const x = all.reduce((sum, one) => sum + one.x, 0) / all.length;
    const y = all.reduce((sum, one) => sum + one.y, 0) / all.length;
    const spread = all.length > 1 ? Math.hypot(all[0].x - all[1].x, all[0].y - all[1].y) : 0;
    return { x, y, spread };
  };

  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    const { x, y } = place(event);
    view.zoom(Math.exp(-event.deltaY * lines * (event.ctrlKey ? 0.01 : 0.0016)), x, y);
    changed();
  }, { passive: false });

  canvas.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(event));
    if (pointers.size === 1) moved = 0;
  });

  canvas.addEventListener("pointermove", (event) => {
    if (!pointers.has(event.pointerId)) return;
    const before = middle();
    pointers.set(event.pointerId, place(event));
    const after = middle();
    moved += Math.abs(after.x - before.x) + Math.abs(after.y - before.y) + Math.abs(after.spread - before.spread);
    if (moved < 5) return;
    canvas.classList.add("dragged");
    view.pan(after.x - before.x, after.y - before.y);
    if (before.spread > 0 && after.spread > 0) view.zoom(after.spread / before.spread, after.x, after.y);
    changed();
  });

  const released = (event) => {
    if (!pointers.has(event.pointerId)) return;
    pointers.delete(event.pointerId);
    canvas.classList.remove("dragged");
    if (event.type !== "pointerup" || pointers.size || moved >= 5) return;
    const { x, y } = place(event);
    const again = event.timeStamp - lastClick.time < 350 && Math.hypot(x - lastClick.x, y - lastClick.y) < 24;
    lastClick = { time: again ? -1e9 : event.timeStamp, x, y };
    if (again && twice) twice(x, y);
    else if (again) {
      view.fit();
      changed();
    } else clicked(x, y);
  };
  canvas.addEventListener("pointerup", released);
  canvas.addEventListener("pointercancel", released);
}
