// Packed columns into numbers: the inverse of crowd_env/rendering/replay/page.py.

async function inflated(text) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let k = 0; k < raw.length; k++) bytes[k] = raw.charCodeAt(k);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function unpacked(bytes, columns) {
  const kinds = { steps: Int16Array, whole: Int32Array, real: Float32Array };
  const found = {};
  let start = 0;
  for (const { name, length, kind, step } of columns) {
    const end = start + length * kinds[kind].BYTES_PER_ELEMENT;
    const values = new kinds[kind](bytes.buffer.slice(start, end));
    start = end;
    if (kind === "steps") {
      for (let k = 1; k < length; k++) values[k] += values[k - 1];
    }
    found[name] = kind === "steps" ? Float32Array.from(values, (value) => value * step) : values;
  }
  return found;
}
