// Start: load the clip's description, then build the page. Keys pressed before are not lost.

import { get } from "./api.js";
import { bind } from "./keys.js";
import { Page } from "./page.js";

const start = async () => {
    const early = [];
    const keep = (event) => early.push(event);
    addEventListener("keydown", keep);
    const page = new Page(await get("/api/clip"), await get("/api/state"));
    removeEventListener("keydown", keep);
    const press = bind(page, page.names);
    page.draw();
    page.go(page.navigation.start(), true);
    early.forEach(press);
};

start();
