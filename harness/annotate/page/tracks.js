// Labels as the server sends them: stretches [first, last, target, note, point, suggested, carried, tags] by position.

const parse = ([first, last, target, note, , suggested, carried, tags = []]) => ({
  first, last, target: target ?? null, note: note || "", suggested: !!suggested, carried: !!carried, tags: tags.join(" "),
});

// A track that has not changed since the last state stays the same object.
export function read(state, before = { texts: {} }) {
  const [tracks, texts] = [{}, {}];
  for (const [name, track] of Object.entries(state.tracks)) {
    texts[name] = JSON.stringify(track);
    tracks[name] = texts[name] === before.texts[name] ? before.tracks[name] : track.map(parse);
  }
  return { ...state, tracks, texts };
}

// Stretches by target only.
export function runs(track) {
  const found = [];
  for (const each of track) {
    const before = found[found.length - 1];
    if (before && ["target", "suggested"].every((key) => before[key] === each[key])) before.last = each.last;
    else found.push({ ...each });
  }
  return found;
}

// Pieces drawn as one: same target, confirmed or not, seen or not.
export function pieces(track, seen) {
  const found = [];
  for (const each of track) {
    const parts = !each.carried || each.last <= seen || each.first > seen
      ? [{ ...each, unseen: each.carried && each.first > seen }]
      : [{ ...each, last: seen, unseen: false }, { ...each, first: seen + 1, unseen: true }];
    for (const part of parts) {
      const before = found[found.length - 1];
      if (before && same(before, part)) before.last = part.last; else found.push(part);
    }
  }
  return found;
}

// Stretches that need work: unlabelled (or not seen yet), or only suggested.
export function open(track, seen) {
  const found = [];
  for (const each of pieces(track, seen)) {
    const kind = each.target === null || each.unseen ? "unlabelled" : each.suggested ? "undecided" : null;
    if (kind) found.push({ first: each.first, last: each.last, kind });
  }
  return found;
}

// Limit the pieces of a window of frames: of pieces that share a place, the longest is drawn.
export function coarse(found, first, count, most) {
  if (found.length <= most) return found;
  const kept = new Map();
  for (const each of found) {
    const place = Math.floor((Math.max(each.first, first) - first) * most / count);
    const other = kept.get(place);
    if (!other || other.last - other.first < each.last - each.first) kept.set(place, each);
  }
  return [...kept.values()];
}

const same = (a, b) =>
  a.target === b.target && a.suggested === b.suggested && a.unseen === b.unseen && a.note === b.note && a.tags === b.tags;

export const at = (track, position) => track.find((each) => each.first <= position && position <= each.last);

// First positions of each target, in order: of the labels, and of the run's suggestions.
export function changes(track, suggestions) {
  const firsts = new Set(runs(track).slice(1).map((each) => each.first));
  (suggestions || []).forEach((each, position) => {
    if (position && (each && each[0]) !== (suggestions[position - 1] && suggestions[position - 1][0])) firsts.add(position);
  });
  return [...firsts].sort((a, b) => a - b);
}
