/* Sources of the extension module are compiled twice, see setup.py; names of those for newer
 * processors. */
#ifdef WB_LEVEL_3
#define wb_solve wb_solve_level_3
#define wb_program wb_program_level_3
#define wb_program_work wb_program_work_level_3
#endif
