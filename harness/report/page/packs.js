// The page's data object and its packs, which are decoded at their first use.

export const data = JSON.parse(document.getElementById("data").textContent);

const parsed = new Promise((resolve) => {
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", resolve);
  else resolve();
});
const kept = new Map();

export function once(key, make) {
  if (!kept.has(key)) kept.set(key, make());
  return kept.get(key);
}

export async function packed(name) {
  await parsed;
  const place = document.getElementById(`pack-${name}`);
  if (!place) return null;
  const bytes = Uint8Array.from(atob(place.textContent.trim()), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

export const packedJson = (name) => once(name, async () => {
  const bytes = await packed(name);
  return bytes && JSON.parse(new TextDecoder().decode(bytes));
});
