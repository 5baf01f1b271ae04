@ Dense layers for ARMv7E-M, and ARMv8-M with the DSP extension. `kernel.rs` explains the method; names below are its names.
@
@ Why a file of assembly: the inner loop needs 14 registers, r6 and r7 among them, which `asm!` does not give, and the
@ compiler would spill some of them in every step.
@
@ Registers in the inner loop
@   r0         stream of weights, always forwards
@   r1         activations
@   r2 - r5    eight activations: (x0, x1) (x2, x3) (x4, x5) (x6, x7); the first is the low half
@   r6 - r9    weights of four columns: (h0, h1) (h2, h3) of the first pair of rows, then of the second
@   r10, r11   first pair of rows: P = 256 A + B, and B (with Winograd's surplus)
@   r12, lr    second pair of rows: the same
@
@ Cycles in comments are the Cortex-M4 TRM's (table 3-1) without wait states: LDM of n words 1 + n, arithmetic 1.

@ Why .cpu although the build knows its processor: the compiler also reads this file for its symbols alone, and then knows none.
@ An ARMv8-M core with the extension executes the same encodings.
    .syntax unified
    .cpu cortex-m4
    .thumb

@ Four columns of four rows, 11 instructions, 15 cycles: 16 products.
@ \x01 holds their first two activations, \x23 the other two.
.macro FOUR_COLUMNS x01, x23
    ldmia.w r0!, {r6-r9}
    smlad   r10, r6, \x01, r10      @ P += h0 x0 + h1 x1
    smlad   r12, r8, \x01, r12
    sxtab16 r6, \x23, r6            @ (x2 + b0, x3 + b1): the low bytes of h0 and h1 are b0 and b1
    sxtab16 r8, \x23, r8
    smlad   r10, r7, \x23, r10      @ P += h2 x2 + h3 x3
    smlad   r12, r9, \x23, r12
    sxtab16 r7, \x01, r7            @ (x0 + b2, x1 + b3)
    sxtab16 r9, \x01, r9
    smlad   r11, r6, r7, r11        @ B += (x2 + b0)(x0 + b2) + (x3 + b1)(x1 + b3)
    smlad   lr, r8, r9, lr
.endm

@ Eight columns: 23 instructions, 35 cycles, and BLOCK_BYTES of code: 4 for each instruction, hence the forced wide LDMs.
.equ BLOCK_BYTES, 92
.macro BLOCK
    ldmia.w r1!, {r2-r5}
    FOUR_COLUMNS r2, r3
    FOUR_COLUMNS r4, r5
.endm

@ The frame that the two layer functions keep on the stack, in bytes from sp.
.equ OUT_PRODUCTS, 0    @ S of the outputs so far
.equ OUT, 4             @ where the next outputs go
.equ OUT_END, 8         @ where they end
.equ ACTIVATIONS, 12    @ where the activations begin
.equ ENTRY, 16          @ where in the unrolled code a row begins
.equ END, 20            @ where the activations end
.equ PRODUCTS, 24       @ S of the activations
.equ FRAME, 28
.equ SAVED, 36          @ r4 - r11 and lr, above the frame

@ Enters a layer function: r0 stream, r1 activations, r2 out, r3 columns; out end and S on the stack.
@
@ A pass through the unrolled blocks covers 2^\log_blocks of them. A row that is not a whole number of passes begins inside
@ the code, so that its first pass is the short one and the last ends, like every other, at the loop's test.
.macro ENTER log_blocks, blocks
    push    {r4-r11, lr}
    sub     sp, #FRAME
    add     r4, r1, r3, lsl #1      @ a column is a halfword
    ldr     r5, [sp, #FRAME + SAVED + 4]
    strd    r4, r5, [sp, #END]
    rsb     r4, r3, #0
    ubfx    r4, r4, #3, #\log_blocks  @ blocks to skip: minus columns / 8 modulo the blocks of a pass
    movs    r5, #BLOCK_BYTES
    adr.w   r6, \blocks
    mla     r4, r4, r5, r6
    orr     r4, #1                  @ BX wants the Thumb bit
    strd    r1, r4, [sp, #ACTIVATIONS]
    ldr     r3, [sp, #FRAME + SAVED]
    movs    r1, #0
    stmia   sp, {r1, r2, r3}
.endm

.macro LEAVE
    ldr     r0, [sp, #OUT_PRODUCTS]
    add     sp, #FRAME
    pop     {r4-r11, pc}
.endm

@ Begins four rows: their sums to start from, and into the unrolled code.
.macro BEGIN_QUAD
    ldmia   r0!, {r10, r11, r12, lr}
    ldrd    r1, r2, [sp, #ACTIVATIONS]
    bx      r2
.endm

@ Ends four rows, or goes back to \blocks for their next pass: r2 - r5 are then the scaled results.
.macro END_QUAD blocks
    ldrd    r6, r7, [sp, #END]
    cmp     r1, r6
    bne.w   \blocks
    ldmia   r0!, {r2-r5}            @ multipliers
    sub     r11, r7                 @ B: Winograd's surplus S goes
    sub     lr, r7
    sub     r10, r11                @ 256 A = P - B
    sub     r12, lr
    asr     r10, #8
    asr     r12, #8
    smmulr  r2, r2, r10             @ (accumulator * multiplier + 2^31) >> 32
    smmulr  r3, r3, r11
    smmulr  r4, r4, r12
    smmulr  r5, r5, lr
.endm

@ i32 freshlane_hidden_layer(stream, activations, next, columns, next_end, S) -> S of the next activations
    .section .text.freshlane_hidden_layer, "ax", %progbits
    .global freshlane_hidden_layer
    .type   freshlane_hidden_layer, %function
    .thumb_func
    .balign 16
freshlane_hidden_layer:
    ENTER   3, .Lhidden_blocks
.Lhidden_quad:
    BEGIN_QUAD
    .balign 4
.Lhidden_blocks:
    .rept 8
    BLOCK
    .endr
    END_QUAD .Lhidden_blocks
    usat    r2, #8, r2              @ clamp to 0..255: ReLU and saturation
    usat    r3, #8, r3
    usat    r4, #8, r4
    usat    r5, #8, r5
    ldmia   sp, {r6, r7, r8}        @ OUT_PRODUCTS, OUT, OUT_END
    pkhbt   r2, r2, r3, lsl #16
    pkhbt   r3, r4, r5, lsl #16
    smlad   r6, r2, r3, r6          @ S += x0 x2 + x1 x3, for the next layer
    stmia   r7!, {r2, r3}
    stmia   sp, {r6, r7}
    cmp     r7, r8
    bne.w   .Lhidden_quad
    LEAVE
    .size freshlane_hidden_layer, . - freshlane_hidden_layer

@ void freshlane_output_layer(stream, activations, outputs, columns, outputs_end, S)
@
@ One or two quads at the end of a network: unrolled less, to stay small.
    .section .text.freshlane_output_layer, "ax", %progbits
    .global freshlane_output_layer
    .type   freshlane_output_layer, %function
    .thumb_func
    .balign 16
freshlane_output_layer:
    ENTER   1, .Loutput_blocks
.Loutput_quad:
    BEGIN_QUAD
    .balign 4
.Loutput_blocks:
    .rept 2
    BLOCK
    .endr
    END_QUAD .Loutput_blocks
    ldrd    r7, r8, [sp, #OUT]      @ and OUT_END
    stmia   r7!, {r2-r5}
    str     r7, [sp, #OUT]
    cmp     r7, r8
    bne.w   .Loutput_quad
    LEAVE
    .size freshlane_output_layer, . - freshlane_output_layer

@ i32 freshlane_pair_products(activations, end) -> S: x0 x2 + x1 x3 of every four, from at least eight
    .section .text.freshlane_pair_products, "ax", %progbits
    .global freshlane_pair_products
    .type   freshlane_pair_products, %function
    .thumb_func
    .balign 16
freshlane_pair_products:
    push    {r4, r5}
    movs    r12, #0
.Lpairs:
    ldmia   r0!, {r2-r5}
    smlad   r12, r2, r3, r12
    smlad   r12, r4, r5, r12
    cmp     r0, r1
    bne     .Lpairs
    mov     r0, r12
    pop     {r4, r5}
    bx      lr
    .size freshlane_pair_products, . - freshlane_pair_products
