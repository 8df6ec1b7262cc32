// Reads what analysis/report/packing.py packed.

const KINDS = {
  u1: Uint8Array, i1: Int8Array, u2: Uint16Array, i2: Int16Array,
  u4: Uint32Array, i4: Int32Array, f4: Float32Array, f8: Float64Array,
};
const GAP = -(2 ** 31);

// The sections by name. Arrays of numbers are typed arrays with a `shape`, row by row.
export async function unpack(base64) {
  const zipped = new Blob([bytesOf(base64.trim())]).stream();
  const buffer = await new Response(zipped.pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
  const length = new DataView(buffer).getUint32(0, true);
  const text = new TextDecoder().decode(new Uint8Array(buffer, 4, length));
  const start = 4 + length;
  return JSON.parse(text, (key, value) =>
    value && value["~"] ? revived(value, buffer, start) : value,
  );
}

function bytesOf(base64) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(base64);
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < bytes.length; i += 1) bytes[i] = text.charCodeAt(i);
  return bytes;
}

function revived({ "~": kind, at, shape, width, step }, buffer, start) {
  const size = shape.reduce((product, side) => product * side, 1);
  const array =
    kind === "steps"
      ? summed(new Uint8Array(buffer, start + at, size * width), shape, size, width, step)
      : new KINDS[kind](buffer, start + at, size);
  array.shape = shape;
  return array;
}

// Differences from row to row, column by column and byte by byte, back into numbers row by row.
function summed(bytes, shape, size, width, step) {
  const rows = shape[0];
  const columns = rows ? size / rows : 0;
  const numbers = new Float32Array(size);
  const unused = 32 - 8 * width;
  for (let column = 0, i = 0; column < columns; column += 1) {
    let level = 0;
    for (let row = 0; row < rows; row += 1, i += 1) {
      let difference = 0;
      for (let plane = 0; plane < width; plane += 1) difference |= bytes[plane * size + i] << (8 * plane);
      level = (level + ((difference << unused) >> unused)) | 0;
      numbers[row * columns + column] = level === GAP ? NaN : level * step;
    }
  }
  return numbers;
}
