// Tracks as the server sends them: { name, kind, keys: [[position, place, outside]] }, and their interpolation.

const before = (keys, position) => keys.findLastIndex(([at]) => at <= position);

// The place, also while outside; linear in the frames' own numbers, as on the server.
export function placeAt({ keys }, position, frames) {
  const index = Math.max(before(keys, position), 0);
  const [at, place] = keys[index];
  const next = keys[index + 1];
  if (position <= at || !next) return place;
  const share = (frames[position] - frames[at]) / (frames[next[0]] - frames[at]);
  return place.map((each, axis) => (1 - share) * each + share * next[1][axis]);
}

// "key", "between", "outside", or "before" the first key frame.
export function stateAt({ keys }, position) {
  const index = before(keys, position);
  if (index < 0) return "before";
  const [at, , outside] = keys[index];
  if (outside) return "outside";
  return at === position ? "key" : "between";
}

export const isKey = ({ keys }, position) => keys.some(([at]) => at === position);

// The next or the previous key frame; undefined if there is none.
export function nextKey({ keys }, position, direction) {
  const all = keys.map(([at]) => at);
  return direction > 0 ? all.find((at) => at > position) : all.findLast((at) => at < position);
}
