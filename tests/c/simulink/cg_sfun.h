/* In place of Simulink's: nothing. */
