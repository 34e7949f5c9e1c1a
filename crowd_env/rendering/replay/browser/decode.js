// Packed columns into numbers: the inverse of crowd_env/rendering/replay/pack.py.

async function inflated(text) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let k = 0; k < raw.length; k++) bytes[k] = raw.charCodeAt(k);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Whole numbers stay exact; lengths become meters from the origin of the plan, so that 32 bits are enough.
function unpacked(bytes, columns) {
  const found = {};
  let start = 0;
  for (const { name, length, step, order } of columns) {
    const whole = new Int32Array(length);
    for (let k = 0; k < length; k++) {
      const at = start + k;
      const zigzag =
        bytes[at] | (bytes[at + length] << 8) | (bytes[at + 2 * length] << 16) | (bytes[at + 3 * length] << 24);
      whole[k] = (zigzag >>> 1) ^ -(zigzag & 1);
    }
    start += 4 * length;
    for (let times = 0; times < order; times++) {
      for (let k = 1; k < length; k++) whole[k] = (whole[k] + whole[k - 1]) | 0;
    }
    if (step === 1) found[name] = whole;
    else {
      const values = new Float32Array(length);
      for (let k = 0; k < length; k++) values[k] = whole[k] * step;
      found[name] = values;
    }
  }
  return found;
}
