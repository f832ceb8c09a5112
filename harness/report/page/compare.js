// A page of tables: of `vfoa compare` and of `vfoa run benchmark`.

import { fillTables } from "./tables.js";

fillTables();
document.documentElement.dataset.ready = "yes";
