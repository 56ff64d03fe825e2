// The model of a page: columns as packed by live_log.py, and the joint's own step

async function unpacked({begin, quantum, order, data}) {
  const packed = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const count = planes.length / 3, values = new Float64Array(count);
  for (let k = 0; k < count; k++) {
    const folded = planes[k] + 256 * planes[count + k] + 65536 * planes[2 * count + k];
    values[k] = folded % 2 ? -(folded + 1) / 2 : folded / 2;
  }
  for (let round = 0; round < order; round++) for (let k = 1; k < count; k++) values[k] += values[k - 1];
  return values.map((level) => begin + level * quantum);
}
function simulated({parameters, added, step: h, u, q, spare, starts, zero, integrated}, moves) {
  const bare = {...parameters};
  for (const [name, by] of Object.entries(moves)) bare[name] += by;
  const c = joint.constants(bare, added), late = (moves.delay ?? 0) / h;
  const whole = Math.floor(late + 1e-9), first = late - whole > 1e-9 ? late - whole : 0;
  const drives = u.map((command) => c.p4 * joint.delivered(command, c)), last = u.length - 1;
  const result = new Float64Array(q.length), which = integrated ? 1 : 0;
  let state = [0, 0, 0, 0], piece = 0;
  for (let k = 0; k < q.length; k++) {
    if (k > 0) {
      const newer = Math.min(Math.max(spare + k - 1 - whole, 0), last), older = Math.max(newer - 1, 0);
      if (first) state = joint.step(state, drives[older], first * h, c);
      state = joint.step(state, drives[newer], (1 - first) * h, c);
    }
    if (piece < starts.length && starts[piece][0] === k) state = [...starts[piece++].slice(1), 0, 0];
    result[k] = zero + state[which];
  }
  return result;
}
function fitOf(measured, model) {
  const mean = measured.reduce((sum, each) => sum + each, 0) / measured.length;
  let error = 0, motion = 0;
  for (let k = 0; k < measured.length; k++) {
    error += (model[k] - measured[k]) ** 2;
    motion += (measured[k] - mean) ** 2;
  }
  return {fit: 100 * (1 - Math.sqrt(error / motion)), rms: Math.sqrt(error / measured.length)};
}
