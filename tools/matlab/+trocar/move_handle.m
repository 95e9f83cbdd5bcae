classdef move_handle < handle
    % A move under way: what move_jp and its like return.

    properties (SetAccess = protected)
        clipped = ''  % joints whose goals lay beyond their limits, from where to where; empty: none
    end

    properties (Access = private)
        bridge
        to
        number
        what
        done = false
        refusal = ''
    end

    methods

        function self = move_handle(bridge, to, reply, what)
            % Made by arms, from the first answer to the command.
            self.bridge = bridge;
            self.to = to;
            self.number = reply.id;
            self.what = what;
            self.done = strcmp(reply.outcome, 'done');
            if strncmp(reply.text, 'clipped: ', 9)
                self.clipped = reply.text(10:end);
                warning('trocar:clipped', '%s was clipped: %s', what, self.clipped);
            end
        end

        function busy = is_busy(self)
            % Whether it still moves; trocar:refused when it ended before its goal.
            if ~self.done && isempty(self.refusal)
                replies = self.bridge.replies_to(self.number);
                for k = 1:numel(replies)
                    self.take(replies{k});
                end
            end
            if ~isempty(self.refusal)
                error('trocar:refused', '%s', self.refusal);
            end
            busy = ~self.done;
        end

        function result = wait(self, is_busy, timeout)
            % Until the goal is reached; trocar:timeout after `timeout` s (30). With `is_busy` true: until it has begun.
            if nargin < 2
                is_busy = false;
            end
            if nargin < 3
                timeout = 30;
            end
            result = true;
            if is_busy
                return
            end
            trocar.internal.wait_until(@() ~self.is_busy(), self.bridge, self.to, timeout, ...
                                  [self.what ' is not done']);
        end

    end

    methods (Access = private)

        function take(self, reply)
            if strcmp(reply.op, 'error')
                self.refusal = [self.what ': ' reply.error];
            elseif any(strcmp(reply.outcome, {'refused', 'failed'}))
                self.refusal = [self.what ' was ' reply.outcome ': ' reply.text];
            end
            self.done = self.done || (isfield(reply, 'outcome') && strcmp(reply.outcome, 'done'));
        end

    end

end
