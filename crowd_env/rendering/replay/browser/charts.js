// People inside and mean pressure over time, one above the other, with the axis of time that the cursor moves on.

const LEFT = 44; // px, for numbers of the axes
const RIGHT = 14;
const BELOW = 32; // for the numbers and the name of the axis of time
const ABOVE = 17; // for the name of a curve

const LONG = 180; // s; longer times are read in minutes

// Multiples of 1, 2 or 5 times a power of ten, or of 1, 2, 5, 10, 15 or 30 minutes if `long`, at most about `most`.
function ticksBetween(begin, end, most, long) {
  if (end - begin < 1e-3) return [Number(begin.toPrecision(6))];
  const power = 10 ** Math.floor(Math.log10((end - begin) / most));
  const minutes = long && power >= 10 && [30, 60, 120, 300, 600, 900, 1800, 3600].find((one) => (end - begin) / one <= most);
  const step = minutes || [1, 2, 5, 10].map((one) => one * power).find((one) => (end - begin) / one <= most);
  const first = Math.ceil(begin / step - 1e-6);
  const count = Math.floor(end / step + 1e-6) - first + 1;
  return Array.from({ length: count }, (_, k) => Number(((first + k) * step).toPrecision(6)));
}

function minutesText(time) {
  return `${Math.floor(time / 60)}:${`${Math.round(time % 60)}`.padStart(2, "0")}`;
}

class Charts {
  constructor(place, recordings, begin, end) {
    Object.assign(this, { place, recordings, begin, end });
    this.canvas = place.querySelector("canvas");
    this.cursor = place.querySelector("#cursor");
    this.charts = [{ name: "People inside", most: largest([recordings.map((one) => one.people)]) || 1, curve: insideCurve }];
    if (recordings.some((one) => one.pressed)) {
      const most = largest(recordings.map((one) => one.meanPressure)) || 1;
      this.charts.push({ name: "Mean pressure on them [N/m]", most: roundUp(most), curve: pressureCurve });
    }
  }

  x(time) {
    return LEFT + ((this.width - LEFT - RIGHT) * (time - this.begin)) / Math.max(this.end - this.begin, 1e-6);
  }

  timeAt(x) {
    const part = (x - LEFT) / Math.max(this.width - LEFT - RIGHT, 1);
    return this.begin + Math.min(Math.max(part, 0), 1) * (this.end - this.begin);
  }

  draw(theme, ratio) {
    const [width, height] = [this.place.clientWidth, this.place.clientHeight];
    Object.assign(this, { width, height });
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    const context = this.canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const each = (height - BELOW) / this.charts.length;
    this.charts.forEach((chart, k) => this.drawOne(context, theme, chart, k * each + ABOVE, (k + 1) * each - 3));
    context.fillStyle = theme.quiet;
    context.font = `11px ${theme.font}`;
    context.textBaseline = "bottom";
    const long = this.end > LONG;
    const ticks = ticksBetween(this.begin, this.end, Math.max(Math.floor(width / 75), 2), long);
    context.strokeStyle = theme.quiet;
    context.lineWidth = 1;
    for (const tick of ticks) {
      const at = Math.round(this.x(tick)) + 0.5;
      context.beginPath();
      context.moveTo(at, height - BELOW - 3);
      context.lineTo(at, height - BELOW + 1);
      context.stroke();
      context.textAlign = "center";
      const text = long ? minutesText(tick) : `${tick}`;
      const x = Math.min(this.x(tick), width - 0.5 * context.measureText(text).width - 2);
      context.fillText(text, x, height - 15);
    }
    context.fillStyle = theme.ink;
    context.fillText(`Time [${long ? "min:s" : "s"}]`, (LEFT + width - RIGHT) / 2, height - 1);
  }

  drawOne(context, theme, { name, most, curve }, top, bottom) {
    context.font = `11px ${theme.font}`;
    context.textBaseline = "middle";
    context.strokeStyle = theme.faint;
    context.lineWidth = 1;
    for (const value of [0, most]) {
      const y = Math.round(bottom - ((bottom - top) * value) / most) + 0.5;
      context.beginPath();
      context.moveTo(LEFT, y);
      context.lineTo(this.width - RIGHT, y);
      context.stroke();
      context.fillStyle = theme.quiet;
      context.textAlign = "right";
      context.fillText(`${Number(value.toPrecision(3))}`, LEFT - 6, y);
    }
    context.textAlign = "left";
    context.fillStyle = theme.ink;
    context.fillText(name, LEFT, top - 9);
    this.recordings.forEach((recording, k) => {
      context.strokeStyle = theme.series[k];
      context.lineWidth = 1.75;
      context.lineJoin = "round";
      context.beginPath();
      curve(recording, (time, value) => {
        context.lineTo(this.x(time), bottom - ((bottom - top) * Math.min(value, most)) / most);
      });
      context.stroke();
    });
  }

  moveCursor(time) {
    this.cursor.style.transform = `translateX(${this.x(time)}px)`;
  }
}

// A step down for everyone who leaves, and up for who comes later.
function insideCurve(recording, point) {
  const steps = [
    ...Array.from(recording.arrivals, (time) => [time, 1]),
    ...Array.from(recording.leavings, (time) => [time, -1]),
  ].filter(([time]) => time > recording.begin && time <= recording.end);
  steps.sort(([a], [b]) => a - b);
  let inside = recording.inside(recording.begin);
  point(recording.begin, inside);
  for (const [time, change] of steps) {
    point(time, inside);
    inside += change;
    point(time, inside);
  }
  point(recording.end, inside);
}

function pressureCurve(recording, point) {
  recording.meanPressure.forEach((value, frame) => point(recording.times[frame], value));
}
