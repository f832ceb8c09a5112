// The link to correct a label: the form of a served page (harness/annotate/correction.py).

import { element } from "./dom.js";
import { data } from "./packs.js";

export function labelLink({ track, i }) {
  if (!data.run) return [];
  const asked = new URLSearchParams({ clip: data.clips[track.clip].name, subject: track.subject, frame: track.frames[i], back: location.pathname + location.search + location.hash });
  return [element("p", {}, element("a", { href: `label?${asked}` }, "The label is wrong"))];
}
