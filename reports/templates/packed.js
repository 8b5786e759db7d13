// Arrays that were packed as text: bytes of equal weight together, zigzag, differences, steps.
const unpacked = async ({ step, order, bytes }, length) => {
  const raw = Uint8Array.from(atob(bytes), (letter) => letter.charCodeAt(0));
  const stream = new Blob([raw]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const size = planes.length / 4;
  const values = Float64Array.from({ length: size }, (_, k) => {
    const word = planes[k] | (planes[size + k] << 8) | (planes[2 * size + k] << 16) | (planes[3 * size + k] << 24);
    return (word >>> 1) ^ -(word & 1);
  });
  for (let pass = 0; pass < order; pass++)
    for (let k = 0; k < size; k++) if (k % length) values[k] += values[k - 1];
  return values.map((value) => value * step);
};
