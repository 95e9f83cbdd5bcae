function wait_until(done, bridge, name, timeout, what)
    % Wait for a condition; trocar:timeout says `what` is not so after `timeout` s.
    limit = trocar.deadline(bridge, name, timeout);
    asked = tic;
    while ~done()
        if limit.is_over()
            error('trocar:timeout', '%s after %g s', what, timeout);
        end
        if toc(asked) > 0.25
            asked = tic;
            bridge.check();
        end
        pause(0.002);
    end
end
