// The start: what the server knows of the clip, then the page.

import { get } from "./api.js";
import { bind } from "./keys.js";
import { Page } from "./page.js";

const [about, state] = await Promise.all([get("/api/clip"), get("/api/state")]);
const page = new Page(about, state);
bind(page, page.names);
page.draw();
await page.go(page.start(), true);
