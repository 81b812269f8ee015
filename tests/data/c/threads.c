/* Threads solve different problems at once and get what one after the other gets, and so does a
 * signal handler in the middle of a solve; the stack that a solve uses is what the header says.
 * threads PROBLEMS (of at least four). */
#include "wideberth_solver.h"

#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/time.h>

enum { THREADS = 4, TIMES = 200, STACK = 1 << 20, PAINT = 165 };

struct task {
    wideberth_problem problem;
    wideberth_result expected;
    unsigned char memory[WIDEBERTH_MEMORY];
    int differ;
};

static struct task tasks[THREADS];
static unsigned char stack[STACK] __attribute__((aligned(65536)));

static int differs(const wideberth_result *one, const wideberth_result *other)
{
    return memcmp(one, other, sizeof(*one)) != 0;
}

static void *solve(void *given)
{
    struct task *task = given;
    wideberth_result found;
    int k;
    for (k = 0; k < TIMES; k++) {
        task->differ |= wideberth_solve(&task->problem, task->memory, WIDEBERTH_MEMORY, &found);
        task->differ |= differs(&found, &task->expected);
    }
    return NULL;
}

static volatile sig_atomic_t interrupted;

static void between(int signal)
{
    static wideberth_result found;
    struct task *task = &tasks[1];
    (void)signal;
    task->differ |= wideberth_solve(&task->problem, task->memory, WIDEBERTH_MEMORY, &found);
    task->differ |= differs(&found, &task->expected);
    interrupted++;
}

/* Solve one problem while a signal comes every 5 ms, whose handler solves another. */
static int within_signals(void)
{
    const struct itimerval often = {{0, 5000}, {0, 5000}}, never = {{0, 0}, {0, 0}};
    struct sigaction handler;
    int k;
    memset(&handler, 0, sizeof(handler));
    handler.sa_handler = between;
    handler.sa_flags = SA_RESTART;
    sigaction(SIGALRM, &handler, NULL);
    setitimer(ITIMER_REAL, &often, NULL);
    for (k = 0; k < 100 && interrupted < 50; k++) solve(&tasks[0]);
    setitimer(ITIMER_REAL, &never, NULL);
    return tasks[0].differ || tasks[1].differ || interrupted < 5;
}

static void *nothing(void *given)
{
    return given;
}

static void *once(void *given)
{
    struct task *task = given;
    static wideberth_result found;
    task->differ |= wideberth_solve(&task->problem, task->memory, WIDEBERTH_MEMORY, &found);
    return NULL;
}

/* Bytes of a painted stack that a thread leaves without paint. */
static int used(void *(*run)(void *))
{
    pthread_attr_t how;
    pthread_t thread;
    int k;
    memset(stack, PAINT, STACK);
    pthread_attr_init(&how);
    pthread_attr_setstack(&how, stack, STACK);
    pthread_create(&thread, &how, run, &tasks[0]);
    pthread_join(thread, NULL);
    for (k = 0; k < STACK && stack[k] == PAINT; k++) continue;
    return STACK - k;
}

int main(int count, char **words)
{
    pthread_t threads[THREADS];
    FILE *in = count > 1 ? fopen(words[1], "rb") : NULL;
    int k, wrong = !in, own;
    for (k = 0; in && k < THREADS; k++) {
        struct task *task = &tasks[k];
        wrong |= fread(&task->problem, sizeof(task->problem), 1, in) != 1;
        wrong |= wideberth_solve(
            &task->problem, task->memory, WIDEBERTH_MEMORY, &task->expected);
    }
    for (k = 0; k < THREADS; k++) pthread_create(&threads[k], NULL, solve, &tasks[k]);
    for (k = 0; k < THREADS; k++) {
        pthread_join(threads[k], NULL);
        wrong |= tasks[k].differ;
    }
    wrong |= within_signals();
    own = used(once) - used(nothing);
    printf("%d %d\n", own, (int)WIDEBERTH_STACK);
    return wrong || own > WIDEBERTH_STACK;
}
