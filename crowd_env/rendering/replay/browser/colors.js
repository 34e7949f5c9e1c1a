// What colors people have, and the legend that says so.

// A round number that is not below `value`, nor far above.
function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(Math.max(value, 1e-9)));
  return [1, 1.5, 2, 3, 4, 5, 6, 8, 10].map((step) => step * power).find((step) => step >= value * (1 - 1e-6));
}

function largest(arrays) {
  let most = 0;
  for (const values of arrays) for (const value of values) if (value > most && value < Infinity) most = value;
  return most;
}

// Ways to color, each with the color number of person n of a recording; -1 = unknown.
function colorings(about, recordings) {
  const steps = about.steps;
  const level = (value, full) => Math.min(Math.max(Math.round((value / full) * (steps - 1)), 0), steps - 1);
  const found = [];
  if (recordings.some((recording) => recording.pressed)) {
    found.push({
      key: "pressure", name: "Pressure", unit: "N/m", full: about.full_pressure, beyond: true,
      title: "Contact pressure, mean of 0.3 s",
      number: (recording, n) => level(recording.nowPressure[n], about.full_pressure),
    });
  }
  const fast = largest(recordings.map((recording) => recording.desired_speed)) || 2;
  const full = Math.max(Math.ceil(2 * fast - 1e-6) / 2, 0.5);
  found.push({
    key: "speed", name: "Speed", unit: "m/s", full, beyond: true, title: "Walking speed",
    number: (recording, n) => level(recording.nowSpeed[n], full),
  });
  const last = largest(recordings.map((recording) => recording.leaving.map((time) => time - recording.begin)));
  if (last > 0) {
    const long = roundUp(last);
    found.push({
      key: "time", name: "Time to own exit", unit: "s", full: long, unknown: "inside to the end",
      title: "Time until this person gets out, as it came about",
      number: (recording, n) =>
        recording.leaving[n] < Infinity ? level(recording.leaving[n] - recording.time, long) : -1,
    });
  }
  const cohorts = [...new Set(recordings.flatMap((recording) => recording.about.cohorts))];
  if (cohorts.length > 1) {
    const of = recordings.map((recording) => recording.about.cohorts.map((name) => cohorts.indexOf(name)));
    found.push({
      key: "cohort", name: "Cohort", cohorts, title: "Cohort",
      number: (recording, n) => of[recordings.indexOf(recording)][recording.cohort[n]] % about.colors.cohort.fill.length,
    });
  }
  return found;
}

function element(kind, properties = {}, ...children) {
  const made = Object.assign(document.createElement(kind), properties);
  made.append(...children);
  return made;
}

function swatch(color) {
  const made = element("i", { className: "swatch" });
  made.style.background = color;
  return made;
}

function showLegend(place, about, coloring) {
  const colors = about.colors[coloring.key].fill;
  place.title = coloring.title;
  place.replaceChildren();
  if (coloring.cohorts) {
    place.append(
      ...coloring.cohorts.map((name, k) => element("span", { className: "entry" }, swatch(colors[k % colors.length]), name || "others")),
    );
  } else {
    const ramp = element("i", { className: "ramp" });
    ramp.style.background = `linear-gradient(to right, ${colors.join(", ")})`;
    const ticks = [0, 0.5, 1].map((part) => {
      const value = Number((part * coloring.full).toPrecision(3));
      const text = part === 1 ? `${coloring.beyond ? "≥ " : ""}${value} ${coloring.unit}` : `${value}`;
      return element("span", { textContent: text });
    });
    place.append(element("span", { className: "scale" }, ramp, element("span", { className: "ticks" }, ...ticks)));
    if (coloring.unknown && about.recordings.some((one) => !one.outcome.startsWith("all out"))) {
      place.append(element("span", { className: "entry" }, swatch(about.colors.unknown.fill[0]), coloring.unknown));
    }
  }
  place.setAttribute("role", "img");
  place.setAttribute("aria-label", `${coloring.title}: ${place.textContent}`);
}
