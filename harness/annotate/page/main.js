// Start: load the clip's description, then build the page. Keys pressed before are not lost.

import { get } from "./api.js";
import { bind } from "./keys.js";
import { Page } from "./page.js";

const early = [];
const keep = (event) => early.push(event);
addEventListener("keydown", keep);
const [about, state] = await Promise.all([get("/api/clip"), get("/api/state")]);
const page = new Page(about, state);
removeEventListener("keydown", keep);
const press = bind(page, page.names);
page.draw();
page.go(page.start(), true);
early.forEach(press);
