// A page of tables, such as that of `vfoa run benchmark`.

import { fillTables } from "./tables.js";

fillTables();
document.documentElement.dataset.ready = "yes";
