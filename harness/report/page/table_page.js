// A page of tables, such as that of `vfoa run benchmark`.

import { sayDrawn } from "./dom.js";
import { fillTables } from "./tables.js";

fillTables();
sayDrawn();
